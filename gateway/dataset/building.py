"""Builds a dataset: bags -> episodes -> a folder that LeRobot loads.

    bag -> series -> rows of each episode -> OUT.building/bag-0000/ -> LeRobot's layout -> OUT

Rules
    * What a bag lacks is told, and is in `meta/teleavatar.json`; nothing is made up, and no row spans a gap.
    * Each bag's episodes are kept in `OUT.building` until all are there: what is broken off goes on where it was.
    * OUT appears at the end, whole. The same bags and choices give the same bytes.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec

from gateway import __version__
from gateway.dataset.bag_videos import FIELD, bag_video_sources, packet_topics
from gateway.dataset.episode import EpisodeFacts, load_episode, store_episode, video_files
from gateway.dataset.layout import Layout
from gateway.dataset.lerobot_format import Format, features_of, write_dataset
from gateway.dataset.parquet import pyarrow
from gateway.dataset.rows import NO_SOURCE, Chosen, choose, runs
from gateway.dataset.series import Instants, Series, read_series
from gateway.dataset.videos import IMAGES, PicturesMissing, decodable, video_source, write_videos
from gateway.errors import Code, failure
from gateway.recording.bag_reader import Bag
from gateway.recording.episodes import episodes
from gateway.robot.vector_layout import EYES

__all__ = ["PROVENANCE", "Built", "Choices", "build", "refuse_full", "told", "write_provenance"]

PROVENANCE: Final = "meta/teleavatar.json"
"""What LeRobot's files do not tell: where each episode and each dimension comes from. LeRobot passes it over."""


class Choices(msgspec.Struct, frozen=True, kw_only=True):
    """How a dataset is built.

    Attributes:
        layout: What its vectors are.
        version: Of LeRobot's format.
        fps: Rows per second.
        task: In words, instead of what was noted; empty for that.
        success_only: Whether only episodes are taken that were judged a success.
        least_rows: Shorter runs without a gap are left out.
        by_arrival: Whether messages count at their arrival instead of their stamp.
        eyes: Which views the cameras are, a key of `vector_layout.EYES`.
    """

    layout: Layout
    version: Format = "v2.1"
    fps: float = 45.0
    task: str = ""
    success_only: bool = False
    least_rows: int = 30
    by_arrival: bool = False
    eyes: str = "vendor_openpi"


class OneBag(msgspec.Struct, frozen=True, kw_only=True):
    """What came of one bag: its episodes, and what was left out, by reason."""

    episodes: tuple[EpisodeFacts, ...]
    left_out: dict[str, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class Built:
    """What was built.

    Attributes:
        folder: Of the dataset.
        episodes: How many.
        rows: In all of them.
        tasks: In words.
        left_out: Rows, or episodes, by reason.
        uncovered: Per feature, groups of dimensions that have no value in any episode and are 0.
        partly: Per dimension group, the share of rows that have a value where it is neither none nor all.
    """

    folder: Path
    episodes: int
    rows: int
    tasks: tuple[str, ...]
    left_out: dict[str, int]
    uncovered: dict[str, tuple[str, ...]]
    partly: dict[str, float]


def build(
    bags: Sequence[Path],
    out: Path,
    choices: Choices,
    on_progress: Callable[[str, float], None] = lambda what, share: None,
    videos: Sequence[Path] = (),
) -> Built:
    """Build a dataset.

    Args:
        bags: Folders, or MCAP files, in the order of their episodes.
        out: Folder to be made.
        choices: How.
        on_progress: Called with what is done, and how much of it, 0..1.
        videos: Recordings of the cameras, one for each bag; without, those that lie in the bags' folders.

    Raises:
        Rejected: BAD_REQUEST, `out` holds something or cannot be written; a bag cannot be read or lacks what the layout needs;
            nothing is left; pyarrow is not installed.
    """
    pyarrow("pyarrow")
    refuse_full(out)
    seen = _videos(bags, videos)
    try:
        return _build(bags, seen, out, choices, on_progress)
    except OSError as error:
        hint = "what is done is kept: mend that, and build again"
        raise failure(Code.BAD_REQUEST, f"{out} cannot be built: {error}", field="out", hint=hint) from error


def _build(
    bags: Sequence[Path],
    seen: Sequence[Path | None],
    out: Path,
    choices: Choices,
    on_progress: Callable[[str, float], None],
) -> Built:
    work = _work_folder(out, bags, seen, choices)
    found: list[EpisodeFacts] = []
    files: list[Path] = []
    left_out: dict[str, int] = {}
    for number, bag in enumerate(bags):
        folder = work / f"bag-{number:04d}"
        if not (folder / "bag.json").exists():
            try:
                _convert(bag, seen[number], folder, choices, on_progress)
            except PicturesMissing:
                _convert(bag, seen[number], folder, choices, on_progress, is_careful=True)
        one = msgspec.json.decode((folder / "bag.json").read_bytes(), type=OneBag)
        found += one.episodes
        files += [_file(folder, n) for n in range(len(one.episodes))]
        for reason, count in one.left_out.items():
            left_out[reason] = left_out.get(reason, 0) + count
    if not found:
        why = "; ".join(f"{count} x {reason}" for reason, count in left_out.items()) or "the bags are empty"
        message = f"no episode is left: {why}"
        shutil.rmtree(work)
        raise failure(Code.BAD_REQUEST, message, field="bag")
    if len({tuple(facts.videos) for facts in found}) > 1:
        named = dict.fromkeys(f"{facts.bag}: {', '.join(facts.videos) or 'none'}" for facts in found)
        message = f"the bags have other cameras: {'; '.join(named)}"
        raise failure(Code.BAD_REQUEST, message, field="bag", hint="build them apart")
    new = work / "dataset"
    shutil.rmtree(new, ignore_errors=True)
    new.mkdir()
    features = features_of(choices.layout, found[0].videos, choices.fps)
    episodes = map(load_episode, found, files)
    write_dataset(
        new, choices.version, features, episodes, choices.fps, lambda n: on_progress("writing", n / len(found))
    )
    built = told(out, choices.layout, found, left_out)
    write_provenance(new, msgspec.to_builtins(choices), EYES[choices.eyes] if found[0].videos else {}, found, built)
    if out.exists():
        out.rmdir()
    new.rename(out)
    shutil.rmtree(work)
    return built


def refuse_full(out: Path) -> None:
    """Raise Rejected, BAD_REQUEST, where a folder holds something."""
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        hint = "name another with --out, or move it away: datasets are never overwritten"
        raise failure(Code.BAD_REQUEST, f"{out} is not empty", field="out", hint=hint)


def _file(folder: Path, number: int) -> Path:
    return folder / f"episode-{number:04d}.npz"


def _videos(bags: Sequence[Path], videos: Sequence[Path]) -> list[Path | None]:
    """Return the recording of the cameras for each bag: all have one, or none has."""
    beside = [sorted(index.with_suffix("") for index in bag.glob("*.jsonl")) if bag.is_dir() else [] for bag in bags]
    found = [*videos] if videos else [files[0] for files in beside if len(files) == 1]
    several = [str(bag) for bag, files in zip(bags, beside, strict=True) if len(files) > 1 and not videos]
    if several or len(found) not in (0, len(bags)):
        message = f"{len(found)} recordings of the cameras for {len(bags)} bags"
        if several:
            message = f"more than one recording of the cameras in {', '.join(several)}"
        hint = "name one for each bag, in their order: --video FILE --video FILE"
        raise failure(Code.BAD_REQUEST, message, field="video", hint=hint)
    return [*found] or [None] * len(bags)


def _work_folder(out: Path, bags: Sequence[Path], videos: Sequence[Path | None], choices: Choices) -> Path:
    """Return the folder in which parts are kept; what another choice or other bags left there is thrown away."""
    work = out.resolve().with_name(out.resolve().name + ".building")
    files = [
        (str(bag.resolve()), file.name, file.stat().st_size, file.stat().st_mtime_ns)
        for bag in (*bags, *filter(None, videos))
        for file in (sorted(bag.glob("*")) if bag.is_dir() else [bag])
        if file.is_file()
    ]
    plan = hashlib.sha256(msgspec.json.encode((__version__, choices, files))).hexdigest()
    if not (work / "plan").exists() or (work / "plan").read_text() != plan:
        shutil.rmtree(work, ignore_errors=True)
        work.mkdir(parents=True)
        (work / "plan").write_text(plan)
    return work


def _convert(
    path: Path,
    video: Path | None,
    folder: Path,
    choices: Choices,
    on_progress: Callable[[str, float], None],
    is_careful: bool = False,
) -> None:
    """Make the episodes of one bag, and note them last: a bag without that note is begun anew.

    A careful one decodes all pictures first: those that cannot be are none.
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    made: list[EpisodeFacts] = []
    times: list[Instants] = []
    views = {IMAGES + camera: view for camera, view in EYES[choices.eyes].items()}
    pictures = [] if video is None else [video_source(video, views)]
    left_out: dict[str, int] = {}
    with ExitStack() as stack:
        bag = stack.enter_context(Bag(path))
        names = [topic.name for topic in bag.topics if topic.count and not topic.alias_of]
        chosen = choose(choices.layout, names, bag.facts().get("namespace", ""))

        def reading(share: float) -> None:
            on_progress(f"reading {path.name}", share)

        packets = packet_topics(bag) if video is None else []
        pairs = chosen.pairs | {(topic, FIELD) for topic in packets}
        series = read_series(bag, pairs, by_arrival=choices.by_arrival, on_progress=reading)
        if packets:
            pictures = bag_video_sources(bag, {topic: series.get((topic, FIELD)) for topic in packets}, views)
        if is_careful:
            pictures = [decodable(one) for one in pictures]
        pictures_ns = {one.topic or "the cameras": one.times_ns for one in pictures}
        for (topic, field), one in series.items():
            if one.rejected:
                left_out[f"message of {topic} without numbers in {field}"] = one.rejected
        for episode in episodes(bag):
            unfit = "discarded" if episode.is_discarded else ""
            if choices.success_only and episode.outcome != "success":
                unfit = unfit or "not judged a success"
            if unfit:
                left_out[f"episode {unfit}"] = left_out.get(f"episode {unfit}", 0) + 1
                continue
            interval_ns = (episode.begin_ns, episode.end_ns)
            found, missing = runs(chosen, series, interval_ns, choices.fps, choices.least_rows, pictures_ns)
            for reason, count in missing.items():
                left_out[f"row: {reason}"] = left_out.get(f"row: {reason}", 0) + count
            for run in found:
                store_episode(_file(folder, len(made)), run.tables)
                times.append(run.times_ns)
                made.append(
                    EpisodeFacts(
                        bag=path.resolve().name,
                        number=episode.number,
                        begin_ns=int(run.times_ns[0]),
                        rows=len(run.times_ns),
                        task=choices.task or episode.task,
                        outcome=episode.outcome,
                        covered=run.covered,
                        sources=_sources(chosen, series),
                    )
                )
    for source in pictures if made else ():
        files = [video_files(_file(folder, number), source.views) for number in range(len(made))]
        wanted = list(zip(times, files, strict=True))
        seen = write_videos(source, wanted, choices.fps, lambda share: on_progress(f"pictures {path.name}", share))
        made = [
            msgspec.structs.replace(facts, videos=facts.videos | one) for facts, one in zip(made, seen, strict=True)
        ]
    whole = folder / "bag.json.new"
    whole.write_bytes(msgspec.json.encode(OneBag(episodes=tuple(made), left_out=left_out)))
    whole.rename(folder / "bag.json")


def _sources(chosen: Chosen, series: dict[tuple[str, str], Series]) -> dict[str, tuple[str, ...]]:
    return {
        feature.name: tuple(one[0] if one and (one[0], one[1].field) in series else "" for one in sources)
        for feature, sources in zip(chosen.layout.feature, chosen.sources, strict=True)
    }


def told(out: Path, layout: Layout, episodes: Sequence[EpisodeFacts], left_out: dict[str, int]) -> Built:
    """Return what is to be told of a dataset in a folder that holds these episodes."""
    rows = sum(episode.rows for episode in episodes)
    uncovered: dict[str, tuple[str, ...]] = {}
    partly: dict[str, float] = {}
    for feature in layout.feature:
        none: list[str] = []
        for number, part in enumerate(feature.part):
            share = sum(each.covered[feature.name][number] * each.rows for each in episodes) / rows
            if share == 0.0:
                none.append(part.label)
            elif share < 1.0:
                partly[f"{feature.name}: {part.label}"] = round(share, 4)
        if none:
            uncovered[feature.name] = tuple(none)
    return Built(
        folder=out,
        episodes=len(episodes),
        rows=rows,
        tasks=tuple(dict.fromkeys(episode.task for episode in episodes)),
        left_out=left_out,
        uncovered=uncovered,
        partly=partly,
    )


def write_provenance(
    folder: Path, choices: dict[str, Any], views: dict[str, str], episodes: Sequence[EpisodeFacts], built: Built
) -> None:
    """Write what LeRobot's files do not tell."""
    facts = {
        "made_by": f"teleavatar-gateway {__version__}",
        "choices": choices,
        "uncovered": {
            name: {"value": 0, "why": NO_SOURCE, "names": list(none)} for name, none in built.uncovered.items()
        },
        "partly_covered": built.partly,
        "left_out": built.left_out,
        "views": views,
        "episodes": [msgspec.to_builtins(episode) for episode in episodes],
    }
    (folder / PROVENANCE).write_text(json.dumps(facts, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
