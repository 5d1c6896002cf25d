"""The commands: find the verb, call its module, turn what it raises into an exit code.

A verb's module is imported only when the verb is used, so that asking for help costs nothing.
"""

import difflib
import errno
import os
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module

from pgm_data import __version__

from .console import UsageError, print_error

INTERNAL, USAGE, NOTHING_USABLE, INTERRUPTED = 1, 2, 4, 130


@dataclass(frozen=True, kw_only=True)
class Verb:
    """One command of `pgm`."""

    module: str
    """Module of this package with `main(argv) -> exit code`."""
    summary: str
    example: str
    """A call that works when the named files are there."""


VERBS: dict[str, Verb] = {
    "calibrate": Verb(
        module="calibrate",
        summary="a camera for every frame of every video",
        example="pgm-calibrate matches/ --out work",
    ),
    "players": Verb(
        module="players",
        summary="the players in metres: skeletons with their feet on the ground",
        example="pgm players work",
    ),
    "ball3d": Verb(
        module="ball3d",
        summary="the ball in metres: its flight, contacts and speeds",
        example="pgm-ball3d work",
    ),
    "caption": Verb(
        module="caption",
        summary="what each player does, in words",
        example="pgm caption work",
    ),
    "view": Verb(
        module="view",
        summary="look at a clip in 3D",
        example="pgm view work",
    ),
    "simulate": Verb(
        module="simulate",
        summary="videos with their exact truth",
        example="pgm simulate --scene tennis --out simulated --matches 2 --seed 1",
    ),
    "train": Verb(
        module="train",
        summary="train the networks, on data with truth",
        example="pgm-train court simulated --out runs/court",
    ),
    "pack": Verb(
        module="pack",
        summary="work folders into one dataset for training and for other tools",
        example="pgm pack work --out dataset",
    ),
    "stats": Verb(
        module="stats",
        summary="what a dataset holds: sequences, hours, frames, captions, words",
        example="pgm stats dataset",
    ),
    "check": Verb(
        module="check",
        summary="validate files, work folders and datasets against the schemas",
        example="pgm check work",
    ),
    "export": Verb(
        module="export",
        summary="write cameras, players, ball, words and labels for other programs",
        example="pgm export colmap work --out colmap",
    ),
    "import": Verb(
        module="import_",
        summary="read work folders and corrections of other programs",
        example="pgm import colmap colmap --out work",
    ),
    "animate": Verb(
        module="animate",
        summary="play from words and wanted states, by a trained model",
        example="pgm animate runs/animation --prompt prompt.json --out made",
    ),
    "render": Verb(
        module="render",
        summary="a clip's states as video, from any view, in any clothes",
        example="pgm render runs/synthesis dataset --clip rally --out rally.mp4",
    ),
    "play": Verb(
        module="play",
        summary="play with trained models in the browser",
        example="pgm play runs/animation runs/synthesis",
    ),
    "evaluate": Verb(
        module="evaluate",
        summary="score a trained model on play that it has not seen",
        example="pgm evaluate runs/animation dataset --out scores",
    ),
    "trade": Verb(
        module="trade",
        summary="accuracy against time of every preset of a stage",
        example="pgm trade calibrate --out trade",
    ),
    "demo": Verb(
        module="demo",
        summary="simulate a short match, annotate, pack and check it, compare with the truth",
        example="pgm demo --out demo",
    ),
    "weights": Verb(
        module="weights",
        summary="fetch the networks that are not bundled",
        example="pgm weights pose",
    ),
    "info": Verb(
        module="info",
        summary="versions, devices, weights and scenes found here",
        example="pgm info --json",
    ),
}


def help_text() -> str:
    """What `pgm --help` prints."""
    width = max(map(len, VERBS))
    lines = [
        "usage: pgm VERB [options]        pgm VERB --help        pgm --version",
        "",
        "From sports video to scenes in metres, and to models that learn from them.",
        "",
        *(f"  {name:<{width}}  {verb.summary}" for name, verb in VERBS.items()),
        "",
        "example: pgm-calibrate matches/ --out work",
        "",
        "exit codes: 0 all well, 1 internal error, 2 usage, 3 some inputs failed, 4 nothing usable,",
        "            5 invalid against the schema, 130 interrupted with its state saved",
        "PGM_DEBUG=1 or --debug shows where an error came from.",
    ]
    return "\n".join(lines)


def run(argv: list[str]) -> int:
    """Carry out `pgm ARGV...`; the exit code."""
    if not argv or argv[0] in ("-h", "--help", "help"):
        print(help_text())
        return 0 if argv else USAGE
    if argv[0] == "--version":
        print(f"pgm {__version__}")
        return 0
    name, rest = argv[0], argv[1:]
    if name not in VERBS:
        near = difflib.get_close_matches(name, VERBS, n=2, cutoff=0.5)
        hint = f"; did you mean {' or '.join(near)}?" if near else ""
        print_error(f"pgm: expected one of {', '.join(VERBS)}, got {name!r}{hint}")
        return USAGE
    return run_verb(name, rest)


def run_verb(name: str, argv: list[str]) -> int:
    """Carry out one verb; the exit code, whatever happens inside."""
    verb = VERBS[name]
    if argv == ["--version"]:
        print(f"pgm {__version__}")
        return 0
    debug = "--debug" in argv or os.environ.get("PGM_DEBUG", "") not in ("", "0")
    argv = [word for word in argv if word != "--debug"]
    if debug:
        os.environ["PGM_DEBUG"] = "1"
    code = _guarded(lambda: import_module(f".{verb.module}", __package__).main(argv), debug=debug)
    if code == 0 and any(word in ("-h", "--help") for word in argv):
        print(f"example: {verb.example}")
    return code


def _guarded(call: Callable[[], int], *, debug: bool) -> int:
    try:
        code = int(call())
        # Here, where a full disk or a closed pipe still has a message and an exit code.
        sys.stdout.flush()
        return code
    except SystemExit as stop:
        return _exit_code(stop)
    except KeyboardInterrupt:
        print_error("interrupted; what was finished is kept, --resume goes on from there")
        return INTERRUPTED
    except BrokenPipeError:
        # Whoever read our output has gone, as `pgm info | head` does.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except UsageError as error:
        if debug:
            traceback.print_exc()
        print_error(str(error))
        return USAGE
    except Exception as error:
        if debug:
            traceback.print_exc()
        code, message = _code_and_message(error)
        print_error(message + ("" if debug else " (--debug shows where)"))
        return code


def _exit_code(stop: SystemExit) -> int:
    if stop.code is None:
        return 0
    if isinstance(stop.code, int):
        return stop.code
    print_error(str(stop.code))
    return INTERNAL


def _code_and_message(error: Exception) -> tuple[int, str]:
    """Exit code and message of an exception that a verb did not expect."""
    if isinstance(error, OSError):
        place = f": {error.filename}" if error.filename else ""
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            return NOTHING_USABLE, f"the disk is full{place}"
        if error.errno in (errno.EACCES, errno.EPERM, errno.EROFS):
            return USAGE, f"not permitted to read or write{place}"
    return INTERNAL, f"{type(error).__name__}: {error}"


def pgm() -> None:
    """Entry point of `pgm`."""
    sys.exit(run(sys.argv[1:]))


def pgm_calibrate() -> None:
    """Entry point of `pgm-calibrate`."""
    sys.exit(run_verb("calibrate", sys.argv[1:]))


def pgm_ball3d() -> None:
    """Entry point of `pgm-ball3d`."""
    sys.exit(run_verb("ball3d", sys.argv[1:]))


def pgm_train() -> None:
    """Entry point of `pgm-train`."""
    sys.exit(run_verb("train", sys.argv[1:]))
