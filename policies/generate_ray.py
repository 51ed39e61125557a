"""A dataset of grasps made by the machines of a Ray cluster, a shard to a task.

All of them must see the folder under the same path. What is missing is made, as by
``ruffini dataset generate``, and the bytes are the same. Use::

    pip install "ruffini[data,ray]"
    python policies/generate_ray.py out --config dataset.toml
    python policies/generate_ray.py out --address auto  # a cluster that runs
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ruffini import dataset


def fill(folder: str, shard: str, config: str | None, settings: dict[str, Any]) -> str:
    """Makes one shard on one thread and returns its name."""
    dataset.generate(folder, config, shards=[shard], threads=1, **settings)
    return shard


def generate(
    folder: str, config: str | None, commit: str = "", **settings: Any
) -> dataset.Dataset | None:
    """The dataset that `ruffini.dataset.generate` makes, by all machines of the cluster."""
    import ray

    remote = ray.remote(num_cpus=1)(fill)
    shards = dataset.shards(config, **settings)
    dataset.generate(folder, config, shards=[], **settings)  # The folder and its meshes.
    left = [remote.remote(folder, shard, config, settings) for shard in shards]
    while left:
        done, left = ray.wait(left)
        print(f"{len(shards) - len(left)}/{len(shards)} shards, {ray.get(done)[0]}", flush=True)
    return dataset.generate(folder, config, commit=commit, **settings)


def main() -> None:
    """Reads the command line and generates."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", help="where the dataset is made; seen by all machines")
    parser.add_argument("--config", help=".toml file; the paper's configuration if not given")
    parser.add_argument("--commit", default="", help="commit of ruffini, for the manifest")
    cluster = parser.add_mutually_exclusive_group()
    cluster.add_argument("--address", help="of a running cluster; one of this machine if not given")
    cluster.add_argument("--cpus", type=int, help="start a cluster of so many on this machine")
    options = parser.parse_args()
    import ray

    # Without an address Ray takes a cluster that runs already, whose size is given.
    address = options.address if options.cpus is None else "local"
    ray.init(address=address, num_cpus=options.cpus, include_dashboard=False)
    config = str(Path(options.config).resolve()) if options.config else None
    made = generate(str(Path(options.folder).resolve()), config, options.commit)
    print(f"{len(made) if made else 0} frames in {options.folder}")


if __name__ == "__main__":
    main()
