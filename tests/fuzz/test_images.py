"""Spoiled jobs, scans and pictures are refused in one line or accepted: nothing else."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from prooflight.errors import InputError
from prooflight.pages.pdf import process as rip_process

pytest.importorskip("pymupdf", reason="PDF needs the extra [pdf]")

MUTANTS, PDF_MUTANTS, SEED = 60, 20, 28


def image_mutants() -> Any:
    path = Path(__file__).with_name("image_mutants.py")
    spec = importlib.util.spec_from_file_location("image_mutants", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


mutants = image_mutants()


@pytest.mark.parametrize("kind", mutants.KINDS)
def test_mutants_are_refused_or_accepted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    sound = mutants.samples(tmp_path)
    assert set(sound) == set(mutants.KINDS)
    path = tmp_path / kind
    path.write_bytes(sound[kind])
    mutants.read(kind, path)
    refused = []
    monkeypatch.setenv(rip_process.SECONDS, "5")
    for number in range(PDF_MUTANTS if kind == "job.pdf" else MUTANTS):
        path.write_bytes(mutants.mutated(kind, sound[kind], np.random.default_rng([SEED, number])))
        try:
            mutants.read(kind, path)
        except InputError as error:
            refused.append(str(error))
    assert refused
    assert all(text.startswith(str(path)) for text in refused)
