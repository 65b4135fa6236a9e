"""Train the network on made bodies; a run that is stopped goes on.

    python -m experiments.learn.train FOLDER [--steps 60000] [--out RESULT.json]

FOLDER holds the shards of `samples.py`; the first two are kept for validation. It gets
`network.eqx`, the state of the run, and at its end the weights that the package ships.
"""

import hashlib
import json
import time
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array

from experiments import command_line, results_file
from experiments.learn.samples import MOST
from jfsf.geometry import geodesics
from jfsf.learned._inputs import NetworkInput
from jfsf.learned._network import DISTANCES, WEIGHTS, Network
from jfsf.mesh import surface_area
from jfsf.mesh._geometry import farthest_vertices
from jfsf.runtime._sizes import with_rows
from jfsf.storage._atomic import write_atomically
from jfsf.types import Mesh

ANCHORS = 256
SOFT = 0.04  # of the answer that is asked for, in sqrt(area); anchors are 0.06 apart
# By hand, as the other numbers here: none was chosen on a set of the protocol.
BATCH = 2
SIZES = 512, 704, MOST  # that batches are padded to
RATE = 2e-3
SEED = 0
EVERY = 500  # steps between two validations


class Data(NamedTuple):
    """Samples of some shards; `starts` says where each begins in the long arrays."""

    starts: np.ndarray
    evals: np.ndarray
    arrays: dict[str, np.ndarray]
    truth: np.ndarray

    def batch(self, at: np.ndarray) -> tuple[NetworkInput, np.ndarray]:
        """Shapes padded to one size, and the template's vertex for each vertex."""
        slices = [slice(self.starts[i], self.starts[i + 1]) for i in at]
        size = max(s.stop - s.start for s in slices)
        n = min(one for one in SIZES if one >= size)
        stack = lambda values: np.stack([with_rows(values[s], n) for s in slices])
        fields = {name: stack(values) for name, values in self.arrays.items()}
        shape = NetworkInput(evals=self.evals[at], **fields)
        return jax.tree.map(lambda a: a.astype(np.float32), shape), stack(self.truth)


def load(paths: list[Path]) -> Data:
    """Shards, one after the other."""
    files = [np.load(path) for path in paths]
    join = lambda name: np.concatenate([file[name] for file in files])
    names = ("mass", "evecs", "slopes", "inputs")
    starts = np.concatenate([[0], np.cumsum(join("sizes"))])
    return Data(
        starts, join("evals"), {name: join(name) for name in names}, join("truth")
    )


def anchors_of(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """(a,) vertices of the template, and (a, v) geodesic distances in sqrt(area)."""
    path = folder / "anchors.npz"
    if not path.exists():
        with np.load(folder / "template.npz") as file:
            mesh = Mesh(file["vertices"].astype(float), file["faces"])
        at = farthest_vertices(mesh, ANCHORS)
        far = geodesics(mesh, at) / np.sqrt(surface_area(mesh))
        write_atomically(path, lambda f: np.savez(f, at=at, far=far.astype(np.float32)))
    with np.load(path) as file:
        return file["at"], file["far"]


def main() -> None:
    parser = command_line.parser(__doc__, out="learn_people.json")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--steps", type=int, default=60000)
    args = command_line.parse(parser)
    paths = sorted(args.folder.glob("shard_*.npz"))
    kept, data = load(paths[:2]), load(paths[2:])
    _, far = anchors_of(args.folder)
    asked = _asked(far)
    number = data.arrays["inputs"].shape[1]
    network = Network(number, len(far) + 1, jax.random.key(SEED))
    schedule = optax.warmup_cosine_decay_schedule(0, RATE, 300, args.steps, 1e-5)
    optimiser = optax.chain(
        optax.clip_by_global_norm(1.0), optax.adamw(schedule, weight_decay=1e-4)
    )
    state = optimiser.init(eqx.filter(network, eqx.is_array))
    step = _step(optimiser, asked)
    begun, curve = _restored(args.folder, (network, state))
    (network, state), start = begun, len(curve) * EVERY
    total, since = 0.0, time.perf_counter()
    for n in range(start, args.steps):
        rng = np.random.default_rng((SEED, n))
        batch = data.batch(rng.choice(len(data.starts) - 1, BATCH, replace=False))
        network, state, loss = step(network, state, *batch)
        total += float(loss)
        if (n + 1) % EVERY == 0:
            row = {"step": n + 1, "loss": total / EVERY} | validated(network, kept, far)
            row["seconds"] = time.perf_counter() - since
            total, since = 0.0, time.perf_counter()
            curve.append(row)
            print(row, flush=True)
            _keep(args.folder, (network, state), curve)
    settings = {"steps": args.steps, "samples": len(data.starts) - 1, "seed": SEED}
    weights = write_weights(network, args.folder)
    results_file.write(args.out, settings=settings, weights=weights, curve=curve)


def write_weights(network: Network, folder: Path) -> dict:
    """In half precision, as the package reads them; their number and the file's hash.

    Copy the file from the folder to `jfsf/learned` to ship it.
    """
    path, (at, far) = folder / WEIGHTS, anchors_of(folder)
    leaves = jax.tree.leaves(eqx.filter(network, eqx.is_array))
    arrays: dict[str, Any] = {
        f"{i:02d}": np.asarray(a, np.float16) for i, a in enumerate(leaves)
    }
    number = sum(a.size for a in arrays.values())
    arrays[DISTANCES] = far[:, at].astype(np.float16)
    write_atomically(path, lambda file: np.savez(file, **arrays))
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    return {"number": number, "sha256": digest}


def _asked(far: np.ndarray) -> Array:
    """(v + 1, a + 1) the answer that is asked for at each vertex of the template.

    The last row is of shapes that are no people, and the last column says that.
    """
    near = jax.nn.softmax(-(jnp.asarray(far.T) ** 2) / (2 * SOFT**2), axis=1)
    return jnp.pad(near, [(0, 1), (0, 1)]).at[-1, -1].set(1)


def _step(optimiser, asked):
    def loss_of(network, shape, truth):
        chance = jax.nn.log_softmax(network(shape))
        return -(shape.mass * (asked[truth] * chance).sum(1)).sum()

    @eqx.filter_jit
    def step(network, state, shapes, truths):
        mean = lambda own: jax.vmap(loss_of, (None, 0, 0))(own, shapes, truths).mean()
        loss, slope = eqx.filter_value_and_grad(mean)(network)
        change, state = optimiser.update(
            slope, state, eqx.filter(network, eqx.is_array)
        )
        return eqx.apply_updates(network, change), state, loss

    return step


def validated(network: Network, data: Data, far: np.ndarray) -> dict:
    """Distance on the template from the truth to the likeliest anchor, of people.

    And the shares of people and of other shapes that are taken for the other kind.
    """
    errors, missed, every = [], {True: [], False: []}, np.arange(len(data.starts) - 1)
    for at in np.array_split(every, max(len(every) // BATCH, 1)):
        shapes, truths = data.batch(at)
        found = np.asarray(_chances(network, shapes))
        for mass, own, truth in zip(shapes.mass, found, truths, strict=True):
            valid = mass > 0
            person = bool(truth[0] < far.shape[1])
            missed[person].append((mass @ own[:, -1] > 0.5) == person)
            if person:
                away = far[own[:, :-1].argmax(1)[valid], truth[valid]]
                errors.append(np.average(away, weights=mass[valid]))
    return {
        "error": float(np.mean(errors)),
        "median": float(np.median(errors)),
        "people missed": float(np.mean(missed[True])),
        "others taken": float(np.mean(missed[False])) if missed[False] else 0.0,
    }


@eqx.filter_jit
def _chances(network, shapes):
    return jax.nn.softmax(jax.vmap(network)(shapes), axis=2)


def _keep(folder: Path, state: Any, curve: list[dict]) -> None:
    write = lambda file: eqx.tree_serialise_leaves(file, (state, np.array(len(curve))))
    write_atomically(folder / "state.eqx", write)
    write_atomically(
        folder / "network.eqx", lambda f: eqx.tree_serialise_leaves(f, state[0])
    )
    results_file.write(folder / "curve.json", curve=curve)


def _restored(folder: Path, state: Any) -> tuple[Any, list[dict]]:
    path = folder / "state.eqx"
    if not path.exists():
        return state, []
    state, _ = eqx.tree_deserialise_leaves(path, (state, np.array(0)))
    return state, json.loads((folder / "curve.json").read_text())["curve"]


if __name__ == "__main__":
    main()
