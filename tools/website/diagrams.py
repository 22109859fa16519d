"""Mermaid diagrams as SVG, drawn when the site is built."""

import hashlib
import re
from pathlib import Path

import mermaidx

BLOCK = re.compile(r"^```mermaid\n(.*?)^```$", flags=re.DOTALL | re.MULTILINE)


def drawn(text: str, folder: Path, cache: Path) -> str:
    """A page with its diagrams as pictures in `folder`, which is next to it; `cache` has earlier pictures."""

    def one(found: re.Match[str]) -> str:
        name = f"{hashlib.sha256(found[1].encode()).hexdigest()[:16]}.svg"
        kept = cache / name
        if not kept.exists():
            cache.mkdir(parents=True, exist_ok=True)
            kept.write_text(_standalone(mermaidx.render(found[1], theme="neutral").svg()), encoding="utf-8")
        folder.mkdir(exist_ok=True)
        (folder / name).write_bytes(kept.read_bytes())
        title = text[: found.start()].rpartition("\n## ")[2].partition("\n")[0].strip("`")
        return f"![Block diagram: {title}]({folder.name}/{name})"

    return BLOCK.sub(one, text)


def _standalone(svg: str) -> str:
    """An SVG with an explicit size, which a picture needs."""
    width, height = re.search(r'viewBox="[\d.-]+ [\d.-]+ ([\d.]+) ([\d.]+)"', svg).groups()
    return re.sub(r'width="100%"', f'width="{width}" height="{height}"', svg, count=1)
