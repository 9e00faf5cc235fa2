"""Something seen in a recording."""

from typing import NamedTuple


class Doubt(NamedTuple):
    """Something seen in a recording."""

    code: str  # as `accept` in the map names it
    level: str  # "error" contradicts the map, "warning" was dealt with, "info" is good to know
    t_ns: int | None  # where it begins; None: everywhere
    text: str
    cure: str = ""  # the line to write in the map
    usual: bool = False  # every import of such a map has it

    @property
    def advice(self) -> str:
        """Return the text, and the line to write."""
        return f"{self.text}; {self.cure}" if self.cure else self.text
