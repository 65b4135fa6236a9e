"""The option `--device` of the benchmarks, for this process and all that it starts."""

import argparse
import os

import jax


def parse(parser: argparse.ArgumentParser) -> argparse.Namespace:
    """The arguments, with `--device` among them, which is done before jax looks.

    An unknown platform, or one that is not there, is an error of jax that names it.
    """
    parser.add_argument(
        "--device",
        metavar="PLATFORM",
        help="cpu, cuda or tpu, as in JAX_PLATFORMS; that which jax prefers if absent",
    )
    args = parser.parse_args()
    if args.device is not None:
        os.environ["JAX_PLATFORMS"] = args.device
        jax.config.update("jax_platforms", args.device)
        jax.devices()
    return args
