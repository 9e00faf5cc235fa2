"""runs and fits → one self-contained HTML page with figures."""

from baqueano.report.page import Drawing, Headline, Page, Section, Table, draw

__all__ = ["Drawing", "Headline", "Page", "Section", "Table", "draw"]
