"""Chains of a program as CmdStan's defaults run them: no metric, start or coordinates of ours."""

import json
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path

from pyburgers.cmdstan.draw_files import Draws, read_draws
from pyburgers.cmdstan.program import Program
from pyburgers.common.processes import side_by_side


def sampled(
    program: Program,
    data: Mapping[str, object],
    folder: Path,
    *,
    chains: int,
    seed: int,
    warmup: int,
    draws: int,
    algorithm: tuple[str, ...],
    thin: int = 1,
) -> Draws:
    """Sample from the origin, two chains side by side; `algorithm` follows ``algorithm=hmc``."""
    folder.mkdir(exist_ok=True)
    data_file = folder / "data.json"
    data_file.write_text(json.dumps(data), encoding="utf-8")
    outputs = [folder / f"draws_{chain}.csv" for chain in range(1, chains + 1)]
    method = ["method=sample", f"num_samples={draws}", f"num_warmup={warmup}", f"thin={thin}"]
    starting = (
        program.start(
            [*method, "algorithm=hmc", *algorithm],
            data=data_file,
            init=0,
            output=output,
            seed=seed,
            chain=chain,
            digits=12,
        )
        for chain, output in enumerate(outputs, start=1)
    )
    with closing(side_by_side(starting, at_once=2)) as looks:
        for _, ended in looks:
            for one in ended:
                assert not one.failed, one.console_tail()
    return read_draws(outputs)
