"""How a field of a schema is described."""

import msgspec


def means(text: str, title: str | None = None, unit: str | None = None) -> msgspec.Meta:
    """Describe a field; `title` is what a form calls it, `unit` is for a name that does not end with one."""
    return msgspec.Meta(title=title, description=text, extra_json_schema={"unit": unit} if unit else None)
