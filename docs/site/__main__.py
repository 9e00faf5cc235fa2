"""`python -m docs.site [FOLDER]`: write the site, build/site unless FOLDER is named, and its first page's path."""

import sys
from pathlib import Path

from docs.site.build import build

folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("build/site")
if not build(folder):
    sys.exit("A page has a warning, above: mend it, then `make docs` again.")
print(folder / "index.html")
