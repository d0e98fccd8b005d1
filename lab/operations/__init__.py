"""How well it holds beside its rivals, and what it costs."""
