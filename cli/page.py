"""One self-contained HTML page of verdicts, tables and figures, and the figures once more as files beside it."""

from __future__ import annotations

import base64
import contextlib
import dataclasses
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from fullsphere.model.errors import OutputError
from fullsphere.model.files import check_output, output_errors, replacing

if TYPE_CHECKING:
    from fullsphere.cli.figures import Drawing

Mark = Literal["good", "look", "poor", ""]
"""How a line of the verdict turned out: as it should be, worth a look, not to be trusted; or only a fact."""


@dataclasses.dataclass(frozen=True)
class Finding:
    """A line of the verdict: what was asked, the answer, and how it is to be taken."""

    name: str
    answer: str
    mark: Mark = ""


@dataclasses.dataclass(frozen=True)
class Table:
    """Rows of text under headings; the first column is to the left, numbers are to the right."""

    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    texts: tuple[int, ...] = (0,)
    """Columns that hold words, not numbers."""


@dataclasses.dataclass(frozen=True, eq=False)
class Section:
    """A part of the page: paragraphs, then tables, then figures."""

    heading: str
    paragraphs: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    drawings: tuple[Drawing, ...] = ()


@dataclasses.dataclass(frozen=True, eq=False)
class Page:
    """Everything on the page; all texts are escaped when it is written."""

    title: str
    findings: tuple[Finding, ...]
    warnings: tuple[str, ...]
    sections: tuple[Section, ...]


def figures_folder(page: Path) -> Path:
    """The folder beside a page that holds its figures as files."""
    return page.with_name(f"{page.stem}-figures")


def check_page(path: Path, overwrite: bool, inputs: Iterable[Path] = ()) -> None:
    """Make sure, before the work, that a page and its figures can be written.

    Raises
    ------
    OutputError
        If they cannot be, or stand there already and `overwrite` is false.
    """
    check_output(path, overwrite, inputs)
    folder = figures_folder(path)
    with output_errors(folder):
        if folder.exists() and not folder.is_dir():
            raise OutputError(f"{folder}: is no folder; the figures of {path.name} go there, so move it away")
        if folder.is_dir() and any(folder.iterdir()) and not overwrite:
            raise OutputError(f"{folder}: exists already; add --overwrite to replace its figures, or name another page")


def write_page(path: Path, page: Page, overwrite: bool) -> None:
    """Write a page, and its figures as PNG and PDF into `figures_folder`: all of them or, on an error, none.

    The same values give the same bytes.  Other files in the folder are left alone.

    Raises
    ------
    OutputError
        If a file cannot be written, or exists and `overwrite` is false.
    """
    drawings = [drawing for section in page.sections for drawing in section.drawings]
    files = {path: _html(page).encode()}
    folder = figures_folder(path)
    for drawing in drawings:
        files[folder / f"{drawing.name}.png"] = drawing.encoded("png")
        files[folder / f"{drawing.name}.pdf"] = drawing.encoded("pdf")
    check_page(path, overwrite)
    with _folder(folder, needed=bool(drawings)), contextlib.ExitStack() as replaced:
        for place, content in files.items():
            temporary = replaced.enter_context(replacing(place, overwrite))
            with output_errors(place):
                temporary.write_bytes(content)


@contextlib.contextmanager
def _folder(folder: Path, needed: bool) -> Iterator[None]:
    """Make a folder for the block, and take it away again if the block fails and leaves it empty."""
    made = needed and not folder.is_dir()
    with output_errors(folder):
        if made:
            folder.mkdir()
    try:
        yield
    except BaseException:
        if made:
            with contextlib.suppress(OSError):
                folder.rmdir()
        raise


def _html(page: Page) -> str:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("fullsphere.cli"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template("report.html.j2").render(page=page, picture=_data_address)


def _data_address(drawing: Drawing) -> str:
    return "data:image/svg+xml;base64," + base64.b64encode(drawing.encoded("svg")).decode("ascii")
