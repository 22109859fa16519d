"""What `make consumers` installs and prints, without installing anything."""

import re
import sys

import pytest

from consumers.__main__ import main, rows, run, updated
from consumers.clients import CLIENTS, Client
from tests.support.paths import ROOT

FOLDER = ROOT / "consumers"
PIN = re.compile(r"[A-Za-z0-9_.-]+(\[[a-z]+\])?==[0-9][A-Za-z0-9.+]*")


@pytest.mark.parametrize("client", CLIENTS, ids=lambda client: client.program)
def test_a_client_has_a_program_and_pinned_requirements(client):
    assert (FOLDER / f"with_{client.program}.py").is_file()
    lines = (FOLDER / "requirements" / f"{client.program}.txt").read_text().splitlines()
    assert lines
    assert not [line for line in lines if not PIN.fullmatch(line)]


def test_every_program_is_run():
    programs = {path.stem.removeprefix("with_") for path in FOLDER.glob("with_*.py")}
    assert programs == {client.program for client in CLIENTS}


def test_a_row_of_the_table():
    learned = {"steps": 1000, "seconds": 4.0, "upright": 0.97, "success": 0.5, "note": "fine"}
    found = rows({Client("A", "a", "vector"): learned, Client("B", "b", "single"): {"error": "no wheel"}})
    assert found["A"] == "| A | vector | 250 | 1,000 | 97% | 50% | fine |\n"
    assert found["B"] == "| B | single |  |  |  |  | no wheel |\n"


def test_rows_of_other_clients_stay():
    page = (ROOT / "docs" / "learners.md").read_text()
    assert updated(page, {}) == page
    again = updated(page, {"skrl": "| skrl | again |\n"})
    changed = [line for line in again.splitlines() if line not in page.splitlines()]
    assert changed == ["| skrl | again |"]
    assert len(again.splitlines()) == len(page.splitlines())


def test_a_program_that_fails_fails_the_job(tmp_path, monkeypatch, capsys):
    def elsewhere(client, wheel):  # noqa: ARG001
        return sys.executable

    monkeypatch.setattr("consumers.__main__.environment", elsewhere)
    assert "No module named consumers.with_nobody" in run(Client("C", "nobody", ""), tmp_path, 1.0)["error"]
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- table of make consumers -->\n| old |\n<!-- end of table -->\nafter\n")
    monkeypatch.setattr("consumers.__main__.run", lambda *_: {"error": "none"})
    monkeypatch.setattr(sys, "argv", ["consumers", "some.whl", "--only", "skrl", "--page", str(page)])
    assert main() == 1
    text = page.read_text()
    assert "old" not in text
    assert text.startswith("before\n")
    assert text.endswith("<!-- end of table -->\nafter\n")
    assert "| skrl |" in capsys.readouterr().out
