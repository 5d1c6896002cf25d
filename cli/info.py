"""`pgm info`: what a report of a fault should say about the installation."""

import hashlib
import json
from dataclasses import asdict, dataclass
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

from .console import table_text
from .weights import weights_rows

EXTRAS: dict[str, tuple[str, ...]] = {
    "text": ("tokenizers",),
    "export": ("onnx", "onnxscript"),
    "dask": ("dask", "distributed"),
    "viz": ("matplotlib", "viser"),
    "pose": ("ai_edge_litert",),
    "hf": ("datasets",),
}
"""Modules that each extra brings."""


@dataclass(frozen=True, kw_only=True)
class InfoOptions:
    """Versions, devices, weights and scenes found here."""

    json: bool = False
    """Print one JSON document instead of tables."""


@dataclass(frozen=True, kw_only=True)
class Weights:
    """A network that is bundled."""

    name: str
    bytes: int
    sha256: str


@dataclass(frozen=True, kw_only=True)
class FetchedWeights:
    """A file of weights that are fetched and not bundled."""

    weights: str
    """What `pgm weights` calls them."""
    name: str
    bytes: int
    here: str
    """`yes`, `no`, or `another` where a file of that name has other contents."""


@dataclass(frozen=True, kw_only=True)
class Installation:
    """What is installed here."""

    versions: dict[str, str]
    commit: str
    """Empty outside a checkout."""
    machine: dict[str, str | int]
    devices: dict[str, list[str]]
    """What torch and onnxruntime can run on."""
    weights: list[Weights]
    fetched_weights: list[FetchedWeights]
    weights_folder: str
    """Where fetched weights are looked for."""
    scenes: list[str]
    extras: dict[str, bool]
    """Whether all that an extra brings is there."""


def installation() -> Installation:
    """What is installed here."""
    from pgm_data.provenance import commit, machine, versions
    from pgm_data.weights import weights_folder

    return Installation(
        versions=versions(),
        commit=commit(),
        machine=machine(),
        devices=devices(),
        weights=bundled_weights(),
        fetched_weights=fetched_weights(),
        weights_folder=str(weights_folder()),
        scenes=bundled_scenes(),
        extras={name: all(find_spec(module) for module in modules) for name, modules in EXTRAS.items()},
    )


def devices() -> dict[str, list[str]]:
    """What torch and onnxruntime can run on."""
    import onnxruntime
    import torch

    return {
        "torch": ["cpu", *(torch.cuda.get_device_name(i) for i in range(torch.cuda.device_count()))],
        "onnxruntime": onnxruntime.get_available_providers(),
    }


def bundled_weights() -> list[Weights]:
    """The networks inside the package."""
    folder = Path(str(files("pgm_data.detect"))) / "weights"
    return [
        Weights(name=path.name, bytes=path.stat().st_size, sha256=hashlib.sha256(path.read_bytes()).hexdigest())
        for path in sorted(folder.glob("*.onnx"))
    ]


def fetched_weights() -> list[FetchedWeights]:
    """The files that `pgm weights` fetches, and whether they are here."""
    from pgm_data.weights import weights_folder

    return [
        FetchedWeights(weights=weights, name=name, bytes=size, here=here)
        for weights, name, size, here, _ in weights_rows(weights_folder())
    ]


def bundled_scenes() -> list[str]:
    """Names of the scenes inside the package."""
    return sorted(Path(entry.name).stem for entry in files("pgm_data.scenes").iterdir() if entry.name.endswith(".yaml"))


def as_text(found: Installation) -> str:
    """The installation as tables for a person."""
    weights = [(entry.name, entry.bytes, entry.sha256) for entry in found.weights]
    fetched = [(entry.weights, entry.name, entry.bytes, entry.here) for entry in found.fetched_weights]
    machine = [
        (name.removesuffix("_bytes"), f"{int(value) / 2**30:.1f} GiB" if name.endswith("_bytes") else value)
        for name, value in found.machine.items()
    ]
    lines = [
        ("commit", found.commit or "not a checkout"),
        *(("device", f"{library}: {', '.join(names)}") for library, names in found.devices.items()),
        ("scenes", ", ".join(found.scenes)),
        ("extras", ", ".join(name if there else f"{name} (absent)" for name, there in found.extras.items())),
    ]
    return "\n\n".join(
        [
            table_text(("package", "version"), list(found.versions.items())),
            table_text(("machine", ""), machine),
            "\n".join(f"{name:<8}{text}" for name, text in lines),
            table_text(("weights", "bytes", "sha256"), weights) if weights else "weights none bundled",
            table_text(("fetched", "file", "bytes", "here"), fetched) + f"\nin {found.weights_folder}",
        ]
    )


def main(argv: list[str]) -> int:
    """Print what is installed; the exit code."""
    import tyro

    options = tyro.cli(InfoOptions, args=argv, prog="pgm info")
    found = installation()
    print(json.dumps(asdict(found), indent=2) if options.json else as_text(found))
    return 0
