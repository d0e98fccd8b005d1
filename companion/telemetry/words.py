"""How a field of a schema is described."""

import msgspec


def means(text: str, title: str | None = None) -> msgspec.Meta:
    """Describe a field, whose unit stands in its name; `title` is what a form calls it."""
    return msgspec.Meta(title=title, description=text)
