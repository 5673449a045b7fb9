"""`pliant export`: a stored run as a data set, or one of its trials as a 3-D recording."""

from pathlib import Path
from typing import Annotated

import tyro

from pliant.cli.steps import counted
from pliant.console import Console
from pliant.errors import InputError
from pliant.paths import located, shown
from pliant.reasoners import needs_extra


def export(
    folder: Annotated[Path, tyro.conf.Positional],
    *,
    lerobot_out: Annotated[Path | None, tyro.conf.arg(name="lerobot")] = None,
    failure_qa_out: Annotated[Path | None, tyro.conf.arg(name="failure-qa")] = None,
    chat_out: Annotated[Path | None, tyro.conf.arg(name="chat")] = None,
    chat_for: str | None = None,
    rerun_out: Annotated[Path | None, tyro.conf.arg(name="rerun")] = None,
    trial: tuple[str, ...] | None = None,
    fps: int = 10,
    cameras: tuple[str, ...] = ("side",),
    workers: int | None = None,
) -> int:
    """Export the trials of a run that kept their record (`pliant experiment … --save all` or
    `--save failures`, `pliant run`). Nothing is overwritten.

    Args:
        folder: the run's folder.
        lerobot_out: a new folder for a LeRobot data set (v3.0).
        failure_qa_out: a new folder for questions and answers about failures, with pictures.
        chat_out: a new folder for conversations to tune a vision-language model on: what it would
            be told and shown, and what was right to answer.
        chat_for: the model whose settings those have, such as local; default: those of any other.
        rerun_out: a new file (.rrd) for Rerun's viewer, of one trial.
        trial: these trials only, by their trial_id; Rerun needs one where the run has several.
        fps: frames a second of the LeRobot data set and of Rerun's timeline, 1 to 25.
        cameras: side, wide or both, for the LeRobot data set.
        workers: processes that draw the LeRobot data set; default one per core.
    """
    from pliant.export import failure_qa, lerobot, recording
    from pliant.export.output import check_new
    from pliant.export.source import open_run

    lerobot_out, failure_qa_out, chat_out, rerun_out = given = [
        None if path is None else located(path)
        for path in (lerobot_out, failure_qa_out, chat_out, rerun_out)
    ]
    outputs = [path for path in given if path is not None]
    if not outputs:
        raise InputError(
            "nothing to export: give --lerobot, --failure-qa, --chat or --rerun with a path"
        )
    if len({path.resolve() for path in outputs}) < len(outputs):
        raise InputError("two exports cannot go to the same path: give each its own")
    if chat_for is not None and chat_out is None:
        raise InputError("--chat-for says how --chat writes: give --chat with a path too")
    if trial == ():
        raise InputError("--trial takes one trial_id or several: give one, or leave --trial out")
    for path in outputs:
        check_new(path)
    source = open_run(folder, *(trial or ()))
    console = Console(highlight=False, soft_wrap=True)
    if rerun_out is not None:
        recorded = recording.write(source, rerun_out, fps=fps)
        console.print(f"rerun: {shown(rerun_out)}: {recorded}")
    if failure_qa_out is not None:
        with counted("failure QA") as steps:
            asked = failure_qa.write(source, failure_qa_out, progress=steps.tell)
        console.print(f"failure QA: {shown(failure_qa_out)}: {_in_words(asked)} questions")
    if chat_out is not None:
        needs_extra("--chat, which writes a model's prompts,")
        from pliant.export import chat
        from pliant.reasoners.vlm.settings import from_fields

        settings = None if chat_for is None else from_fields({"model": chat_for})
        with counted("chat") as steps:
            told = chat.write(source, chat_out, settings, progress=steps.tell)
        console.print(f"chat: {shown(chat_out)}: {_in_words(told)} conversations")
    if lerobot_out is not None:
        with counted("LeRobot") as steps:
            made_of = lerobot.write(
                source,
                lerobot_out,
                fps=fps,
                cameras=cameras,
                workers=workers,
                progress=steps.tell,
            )
        console.print(f"LeRobot: {shown(lerobot_out)}: {_in_words(made_of)} episodes")
    return 0


def _in_words(splits: dict[str, int]) -> str:
    return ", ".join(f"{n} {split}" for split, n in splits.items())
