"""The math font as a style sheet: without a table MATH browsers place indices arbitrarily."""

import base64
import importlib.resources
from io import BytesIO
from pathlib import Path

from fontTools.subset import Options, Subsetter
from fontTools.ttLib import TTFont

#: Letters, Greek, accents, punctuation, arrows, operators, brackets, and the italic and bold letters of formulas.
RANGES = (
    (0x20, 0x7E), (0xA0, 0xFF), (0x2C6, 0x2DD), (0x300, 0x33F), (0x370, 0x3FF), (0x2010, 0x2064), (0x20D0, 0x20EF),
    (0x2100, 0x214F), (0x2190, 0x21FF), (0x2200, 0x22FF), (0x2308, 0x230B), (0x239B, 0x23B1), (0x27E8, 0x27EB),
    (0x1D400, 0x1D467), (0x1D49C, 0x1D4CF), (0x1D538, 0x1D56B), (0x1D6A8, 0x1D71B), (0x1D7CE, 0x1D7D7),
)  # fmt: skip
#: Inside the style sheet, since a page opened as a file must not read another file.
SHEET = """@font-face {{
  font-family: "Mathematics";
  src: local("STIX Two Math"), url(data:font/woff;base64,{data}) format("woff");
}}
"""


def write(sheet: Path) -> None:
    """Writes a subset of STIX Two Math, which ziamath includes, with its table MATH."""
    file = importlib.resources.files("ziamath") / "fonts" / "STIXTwoMath-Regular.ttf"
    font = TTFont(BytesIO(file.read_bytes()))
    options = Options()
    options.layout_features = ["ssty", "kern"]
    options.notdef_outline = True
    subsetter = Subsetter(options)
    subsetter.populate(unicodes=[code for first, last in RANGES for code in range(first, last + 1)])
    subsetter.subset(font)
    font.flavor = "woff"
    written = BytesIO()
    font.save(written)
    sheet.parent.mkdir(parents=True, exist_ok=True)
    sheet.write_text(SHEET.format(data=base64.b64encode(written.getvalue()).decode()), encoding="ascii")
