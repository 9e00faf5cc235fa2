"""Write the site into FOLDER, and print the path of its first page: `python -m docs.site [FOLDER]`."""

import sys
from pathlib import Path

from docs.site.build import build

folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("build/site")
if not build(folder):
    sys.exit("A page has a warning, above. Correct the page, then type `make docs` again.")
print(folder / "index.html")
