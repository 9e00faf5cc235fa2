"""Write runs, fits and other results as one self-contained HTML page with figures."""

from typing import TYPE_CHECKING

from baqueano.on_demand import on_demand
from baqueano.report.page import Drawing, Headline, Page, Section, Table, draw

if TYPE_CHECKING:
    from baqueano.report.pages.result_page import report

__all__ = ["Page", "report"]

__getattr__ = on_demand(__name__, {"pages.result_page": ("report",)})
