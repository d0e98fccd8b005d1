"""Let numba compile `record._replace(field=value, ...)` of a NamedTuple, which it does not by itself.

As in `pipeline.py` these are numba's inner classes: `tests/unit/test_compiled.py` fails where another version
has others.
"""

from inspect import Parameter, Signature
from typing import Any

import numba.core.types
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import AbstractTemplate, AttributeTemplate, infer_getattr, signature

types: Any = numba.core.types


class _Replace(AbstractTemplate):  # type: ignore[misc]
    key = "named_tuple._replace"

    def generic(self, args: Any, kws: dict[str, Any]) -> Any:
        record = self.this
        if args or not kws.keys() <= set(record.fields):
            return None
        before = zip(record.fields, record.types, strict=True)
        result = types.BaseTuple.from_types(
            [kws.get(name, kind) for name, kind in before], record.instance_class
        )
        given = [kws.get(name, types.Omitted(None)) for name in record.fields]
        names = [Parameter(name, Parameter.POSITIONAL_OR_KEYWORD, default=None) for name in record.fields]
        return signature(result, *given, recvr=record).replace(pysig=Signature(names))


@infer_getattr
class _Method(AttributeTemplate):  # type: ignore[misc]
    key = types.BaseTuple

    def resolve__replace(self, record: Any) -> Any:
        return types.BoundFunction(_Replace, record) if isinstance(record, types.BaseNamedTuple) else None


@lower_builtin(_Replace.key, types.BaseNamedTuple, types.VarArg(types.Any))  # type: ignore[untyped-decorator]
def _replaced(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    record, *given = sig.args
    parts = []
    for i, (kind, new, value) in enumerate(zip(given, sig.return_type.types, args[1:], strict=True)):
        if isinstance(kind, types.Omitted):
            kind, value = record.types[i], builder.extract_value(args[0], i)
        parts.append(context.cast(builder, value, kind, new))
        context.nrt.incref(builder, new, parts[-1])
    return context.make_tuple(builder, sig.return_type, parts)
