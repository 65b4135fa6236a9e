"""What the scripts share on their command lines: `--data`, `--out` and `--device`."""

import argparse
import os
from pathlib import Path

import jax

RESULTS = Path(__file__).parent / "results"


def parser(
    about: str | None, *, out: str | Path | None = None, data: bool | str = False
) -> argparse.ArgumentParser:
    """A parser with the options that all scripts have.

    Args:
        about: the docstring of the script, shown as it stands.
        out: file that is written where `--out` is not given: the name of one in
            `results/`, or a path. Without it the script says what it does then.
        data: with `--data`, the folder that holds the sets of
            `experiments.accuracy.protocol`, which is JFSF_DATA where it is not given;
            "optional" for a script that can do without.
    """
    made = argparse.ArgumentParser(
        description=about, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    file = RESULTS / out if isinstance(out, str) else out
    made.add_argument("--out", type=Path, default=file, help="the file to write")
    made.add_argument(
        "--device",
        metavar="PLATFORM",
        help="cpu, cuda or tpu, as in JAX_PLATFORMS; that which jax prefers if absent",
    )
    if data:
        folder = os.environ.get("JFSF_DATA")
        made.add_argument(
            "--data",
            type=Path,
            default=folder,
            required=data != "optional" and folder is None,
            help="root of the data sets; default: JFSF_DATA",
        )
    return made


def parse(options: argparse.ArgumentParser) -> argparse.Namespace:
    """The arguments. The device is chosen before jax looks, for all that is started.

    An unknown platform, or one that is not there, is an error of jax that names it.
    """
    args = options.parse_args()
    if args.device is not None:
        os.environ["JAX_PLATFORMS"] = args.device
        jax.config.update("jax_platforms", args.device)
        jax.devices()
    return args
