"""Read an exported data set with the real lerobot, in an environment that has it.

    python reproduce/lerobot_reader.py DATA

lerobot_reader.sh makes such an environment. It reads every episode's first and last frame through
lerobot, films included, and compares them with the Parquet files; then a shuffled batch.
"""

import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import torch
from lerobot.datasets.lerobot_dataset import LeRobotDataset


def main(root: Path) -> None:
    data = LeRobotDataset("pliant/export", root=root, video_backend="pyav")
    frames = pq.read_table(sorted((root / "data").glob("*/*.parquet")))
    episodes = data.meta.episodes
    assert len(data) == len(frames) == data.meta.total_frames
    assert len(episodes) == data.meta.total_episodes
    for episode in episodes:
        begin, end = episode["dataset_from_index"], episode["dataset_to_index"]
        for index in (begin, end - 1):
            read, stored = data[index], frames.slice(index, 1).to_pylist()[0]
            for name, value in stored.items():
                assert np.array_equal(np.asarray(read[name]), np.float32(value)), name
            for key in data.meta.video_keys:
                assert tuple(read[key].shape) == (3, 480, 640)
                assert 0.0 <= float(read[key].min()) < float(read[key].max()) <= 1.0
            assert read["task"] == episode["tasks"][0]
        assert bool(read["next.done"])
        assert bool(read["next.success"]) == episode["trial/inserted"]
    steps = {"action": [n / data.fps for n in range(4)]}
    chunked = LeRobotDataset(
        "pliant/export", root=root, video_backend="pyav", delta_timestamps=steps
    )
    batch = next(iter(torch.utils.data.DataLoader(chunked, batch_size=8, shuffle=True)))
    assert tuple(batch["action"].shape) == (min(8, len(data)), 4, 6)
    labels = {name: sum(map(bool, episodes[f"trial/{name}"])) for name in ("inserted", "judged")}
    print(f"{len(episodes)} episodes, {len(data)} frames, splits {data.meta.info.splits}, {labels}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
