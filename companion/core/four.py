"""The same for each of four: degrees of freedom, axes, or a group's motors; numba compiles no generator."""

from collections.abc import Callable
from typing import Any, TypeVar

T = TypeVar("T")
Four = tuple[T, T, T, T]


def each(function: Callable[..., T], one: tuple[Any, Any, Any, Any], *shared: Any) -> Four[T]:
    """Return what `function` makes of each, and of what they share."""
    return (
        function(one[0], *shared),
        function(one[1], *shared),
        function(one[2], *shared),
        function(one[3], *shared),
    )


def each_of_two(
    function: Callable[..., T], one: tuple[Any, Any, Any, Any], two: tuple[Any, Any, Any, Any], *shared: Any
) -> Four[T]:
    """Return what `function` makes of each of `one` with that of `two`, and of what they share."""
    return (
        function(one[0], two[0], *shared),
        function(one[1], two[1], *shared),
        function(one[2], two[2], *shared),
        function(one[3], two[3], *shared),
    )
