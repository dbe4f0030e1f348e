"""Tables of completion: README, docs/completion.md, docs/files.md, docs/evaluation.md and the network's card."""

from __future__ import annotations

from bodysense.devices.simulated.sensors import SENSOR_SETS
from bodysense_lab.completion.score.holes import PARTS as HOLES
from bodysense_lab.completion.score.holes import SECONDS
from bodysense_lab.completion.score.scripted.scene_scoring import SETS as SCENE_SETS
from bodysense_lab.completion.score.scripted.scene_tables import FAULTS
from bodysense_lab.completion.score.sight.wearer_scores import RARE_SETS, SEATED_HEIGHTS, SEATED_SETS
from bodysense_lab.completion.score.sight.wearers import PALMS, RAISES
from bodysense_lab.completion.training.options import BODIES, BODY_TITLES, TABLE_SETS
from bodysense_lab.core.model_card import network_lines, parse_fields, read_network
from bodysense_lab.papers.hmd_vae.tables import PUBLISHED as THREE_POINT
from bodysense_lab.synthesis.scenes import KINDS as SCENES

from .blocks import ROOT, Block, Numbers, between, figure, markdown, sampled

CARD = "src/bodysense/weights/completion.md"
BACKWARD_CARD = "src/bodysense/weights/completion_backward.md"
JOINING_CARD = "src/bodysense/weights/completion_joining.md"


def network(validation: Numbers | None) -> str:
    """Return what the completion network's file says of itself, and its validation figures if there are any."""
    return _described(CARD, validation, "", "")


def backward_network() -> str:
    """Return the same of the network for time that runs backward, which completes nothing alone."""
    return _described(BACKWARD_CARD, None, "", "")


def joining_network(validation: Numbers | None) -> str:
    """Return the same of the joining network; its figures are of takes."""
    return _described(JOINING_CARD, validation, "take_", ", completed in both directions and joined")


def _described(card: str, validation: Numbers | None, kind: str, said: str) -> str:
    fields, _ = read_network((ROOT / card).with_suffix(".safetensors"))
    lines = network_lines(parse_fields(fields))
    if validation is not None:
        figures = ", ".join(
            f"{_sensors(name)} {figure(validation, f'{name}_own_{kind}{_position(name)}')}"
            for name in TABLE_SETS
            if f"{name}_own_{kind}{_position(name)}" in validation
        )
        lines.append(f"- validation people, known bodies{said}, cm: {figures}")
    return "\n".join(lines)


def takes(numbers: Numbers) -> str:
    """Live and with past and future, by sensors; of a headset's cameras the hidden joints."""
    rows = []
    for name in TABLE_SETS:
        error = "occluded_mpjpe_cm" if name == "headset_camera" else "mpjpe_cm"
        keys = [
            f"{name}_own_{error}",
            f"{name}_own_take_{error}",
            f"{name}_nothing_{error}",
            f"{name}_nothing_take_{error}",
        ]
        keys += [f"{name}_own_take_rotation_deg", f"{name}_own_take_jumps_per_minute"]
        if keys[1] in numbers:
            figures = [f"{numbers[key]:.2f}" if key in numbers else "–" for key in keys]
            covers = numbers.get(f"{name}_own_take_cover90")
            rows.append([name.replace("_", " "), *figures, "–" if covers is None else f"{100 * covers:.0f}"])
    head = ["sensors", "known body, live cm", "take cm", "unknown body, live cm", "take cm", "take rotation °"]
    command = f"`bodysense evaluate completion --data DIR{_limit(numbers)} --takes`: {sampled(numbers)}."
    command += between(numbers, "head_own_low_cm", "head_own_high_cm", "The head alone, known body, live")
    return f"{markdown([*head, 'take jumps/min', 'bound covers %'], rows)}\n\n{command}"


def holes(body: Numbers, fingers: Numbers) -> str:
    """Errors of filled holes by part and length, those of the best other method, and how many gaps they are of."""
    rows = []
    for part in HOLES:
        numbers, cells = fingers if part == "fingers" else body, []
        for seconds in SECONDS:
            key = f"{part}_{seconds:g}"
            found = f"{key}_cm" in numbers
            cells.append(f"{numbers[f'{key}_cm']:.2f} ({numbers[f'{key}_best_other_cm']:.2f})" if found else "–")
        rows.append([part.replace("_", " "), *cells])
    for name, numbers, part in (("gaps of each part", body, "arm"), ("gaps of fingers", fingers, "fingers")):
        rows.append([name, *(f"{numbers.get(f'{part}_{seconds:g}_gaps', 0):.0f}" for seconds in SECONDS)])
    table = markdown(["part", *(f"{seconds:g} s" for seconds in SECONDS)], rows)
    sample = f" --clips {body['clips']:.0f}" if body["clips"] < body["clips_in_split"] else ""
    return (
        f"{table}\n\n`bodysense evaluate holes --data DIR{sample}`: {sampled(body)}. "
        "Fingers: all clips that have some (`--parts fingers`)."
        + between(body, "arm_1_low_cm", "arm_1_high_cm", "An arm, 1 s")
    )


def completion(numbers: Numbers, sample: Numbers) -> str:
    """Sensor sets by bodies, short: mean errors of joints of all clips; of a sample whether more sensors help."""
    rows = [
        [_sensors(name), *(figure(numbers, f"{name}_{body}_{_position(name)}") for body in BODIES)]
        for name in TABLE_SETS
        if f"{name}_own_{_position(name)}" in numbers
    ]
    head = ["sensors", *(BODY_TITLES[body] for body in BODIES)]
    text = [
        f"`bodysense evaluate completion --data DIR{_limit(numbers)}`: {numbers['clips']:.0f} clips, main motions, cm.",
        "22 joints relative to the head; for the headset camera, the joints that it does not see, in the world.",
    ]
    if "headset_camera_stranger_ratio" in numbers:
        ratio = [numbers[f"headset_camera_{body}_ratio"] for body in ("own", "stranger")]
        text.append(
            "RMSJPE of these hidden joints, relative to the best way to hold the last known position: "
            f"{ratio[0]:.2f} (own body), {ratio[1]:.2f} (unseen body)."
        )
    if "lattice_edges" in sample:
        text.append(
            f"On {sampled(sample)}, one sensor more is worse by over 1 % in {sample['lattice_violations']:.0f} of "
            f"{sample['lattice_edges']:.0f} random pairs of sensor sets."
        )
    return f"{markdown(head, rows)}\n\n" + "\n".join(text)


def _limit(numbers: Numbers) -> str:
    """Return the option of a command that scored some of the clips; empty if it scored all."""
    return f" --limit {numbers['clips']:.0f}" if numbers["clips"] < numbers["clips_in_split"] else ""


def completion_measures(numbers: Numbers) -> str:
    """Return every measure of every sensor set and body, intervals, and how true expected errors are."""
    measures = {
        "rotation °": "rotation_deg",
        "lower cm": "lower_mpjpe_cm",
        "upper cm": "upper_mpjpe_cm",
        "velocity cm/s": "velocity_cm_s",
        "jitter": "jitter",
        "skate cm/s": "skate_cm_s",
        "under floor cm": "depth_cm",
        "jumps/min": "jumps_per_minute",
    }
    rows = [
        [
            _sensors(name),
            BODY_TITLES[body],
            figure(numbers, f"{name}_{body}_{_position(name)}"),
            *(figure(numbers, f"{name}_{body}_{measure}") for measure in measures.values()),
        ]
        for name in TABLE_SETS
        for body in BODIES
        if f"{name}_{body}_mpjpe_cm" in numbers
    ]
    trust = [
        [
            _sensors(name),
            figure(numbers, f"{name}_ece", 3),
            figure(numbers, f"{name}_cover90", 3),
            figure(numbers, f"{name}_spearman"),
        ]
        for name in TABLE_SETS
        if f"{name}_ece" in numbers
    ]
    sure = [
        [
            _sensors(name),
            BODY_TITLES[body],
            _between(numbers, f"{name}_{body}"),
            "" if body == "own" else _between(numbers, f"{name}_{body}_minus_own", signed=True),
        ]
        for name in TABLE_SETS
        for body in BODIES
        if f"{name}_{body}_low_cm" in numbers
    ]
    first = markdown(["sensors", "body", "MPJPE cm", *measures], rows)
    second = markdown(["expected errors", "ECE", "within the 90 % interval", "rank correlation with the true"], trust)
    text = f"{first}\n\nJitter in 10² m/s³; skate of feet that truly stand.\n\n"
    if sure:
        text += markdown(["sensors", "body", "MPJPE lies between, cm", "more than own, cm"], sure)
        text += "\n\n95 % intervals by bootstrap over people. "
        text += "A difference with 0 in its interval is not significant.\n\n"
    return text + second


def _between(numbers: Numbers, key: str, signed: bool = False) -> str:
    sign = "+" if signed else ""
    return f"{numbers[f'{key}_low_cm']:{sign}.2f} to {numbers[f'{key}_high_cm']:{sign}.2f}"


LEGS = {  # measures of sight of legs: column, and the factor of its figures
    "float_share": ("float %", 100),
    "low_float_share": ("low float %", 100),
    "standing_knee_deg": ("standing knee °", 1),
    "knee_excess_deg": ("knee over °", 1),
    "backward_knee_share": ("knee back %", 100),
    "false_steps_per_minute": ("false steps/min", 1),
    "missed_steps_share": ("missed %", 100),
    "wrong_foot_share": ("wrong %", 100),
}
MOTION = {  # of the motion of all joints, and of measured ones
    "jumps_per_minute": ("jumps/min", 1),
    "jumps_at_change_per_minute": ("at a change", 1),
    "jumps_elsewhere_per_minute": ("elsewhere", 1),
    "extra_jumps_per_minute": ("by a blink", 1),
    "frozen_share": ("frozen %", 100),
    "reentry_speed_m_s": ("re-entry m/s", 1),
    "pj_ratio": ("PJ", 1),
    "elbow_deg": ("elbow °", 1),
    "measured_p95_cm": ("seen p95 cm", 1),
    "measured_rotation_deg": ("seen p95 °", 1),
    "measured_covered": ("in its bound %", 100),
}


def sight(numbers: Numbers) -> str:
    """Return the measures of sight of every scored sensor set with known proportions, and what bounds cover by body."""
    scored = [sensors for sensors in TABLE_SETS if f"{sensors}_own_jumps_per_minute" in numbers]
    tables = []
    for measures in (LEGS, MOTION):
        rows = [
            [
                _sensors(sensors),
                *(_scaled(numbers, f"{sensors}_own_{name}", factor) for name, (_, factor) in measures.items()),
            ]
            for sensors in scored
        ]
        tables.append(markdown(["sensors", *(name for name, _ in measures.values())], rows))
    tables.append(f"The recording's own body, known; main categories of {numbers['clips']:.0f} clips.")
    covers = [
        [_sensors(sensors), *(_scaled(numbers, f"{sensors}_{body}_cover90", 100) for body in BODIES)]
        for sensors in scored
    ]
    tables.append(markdown(["90 % bound covers, %", *(BODY_TITLES[body] for body in BODIES)], covers))
    return "\n\n".join(tables)


def wearers(numbers: Numbers) -> str:
    """Return the figures of scripted wearers and of the heads of real headsets."""
    standing = [
        [
            f"palms {palms}" if palms != "none" else "head alone",
            figure(numbers, f"standing_{palms}_ball_cm"),
            figure(numbers, f"standing_{palms}_knee_deg"),
            _scaled(numbers, f"headset_{palms}_float_share", 100),
        ]
        for palms in PALMS
    ]
    seated = [
        [
            f"{height:.2f} m, {_sensors(sensors)}",
            *(
                figure(numbers, f"seated_{round(100 * height)}_{sensors}_{what}_cm")
                for what in ("pelvis", "error", "height")
            ),
        ]
        for height in SEATED_HEIGHTS
        for sensors in SEATED_SETS
    ]
    raised = [[way, figure(numbers, f"raised_{way}_truth_deg"), figure(numbers, f"raised_{way}_deg")] for way in RAISES]
    rare = [
        [
            _sensors(sensors),
            *(
                _scaled(numbers, f"rare_{sensors}_{what}", 100)
                for what in ("covered", "least_covered", "backward_knee_share")
            ),
        ]
        for sensors in RARE_SETS
        if f"rare_{sensors}_covered" in numbers
    ]
    tables = [
        markdown(["stands", "lower ball cm", "knee °", "real headsets: float %"], standing),
        markdown(["sits, nothing known", "pelvis cm", "joints cm", "shortest height, from true cm"], seated),
        markdown(["arms raised out of view", "truth °", "output °"], raised),
    ]
    if rare:
        tables.append(markdown(["rare poses", "90 % bound covers, %", "least of a pose", "knee back %"], rare))
    return "\n\n".join(tables)


def scenes(numbers: Numbers) -> str:
    """Return errors and visible faults in scripted scenes by sensor set, and those of heads of real headsets."""
    sets = [name for name in SCENE_SETS if f"scenes_{name}_error_cm" in numbers]
    faults = [
        [title, *(_scaled(numbers, f"scenes_{name}_{key}", factor) for name in sets)]
        for key, title, factor in FAULTS
        if any(f"scenes_{name}_{key}" in numbers for name in sets)
    ]
    kinds = [
        [kind.replace("_", " "), *(figure(numbers, f"scenes_{name}_{kind}_error_cm") for name in sets)]
        for kind in SCENES
        if f"scenes_{sets[0]}_{kind}_error_cm" in numbers
    ]
    titles = [SCENE_SETS[name].title for name in sets]
    tables = [markdown(["measure", *titles], faults), markdown(["error by scene, cm", *titles], kinds)]
    heads = [
        [
            f"palms {palms}" if palms != "none" else "head alone",
            *(_scaled(numbers, f"headset_{palms}_{what}_share", 100) for what in ("gliding", "float")),
        ]
        for palms in PALMS
        if f"headset_{palms}_gliding_share" in numbers
    ]
    if heads:
        tables.append(markdown(["real headsets, unknown bodies", "gliding %", "float %"], heads))
    return "\n\n".join(tables)


def _scaled(numbers: Numbers, key: str, factor: float) -> str:
    return f"{factor * numbers[key]:.2f}" if key in numbers else "–"


def published(numbers: Numbers) -> str:
    """Return the figures of three points, next to published ones."""
    columns = ("mpjpe_cm", "velocity_cm_s", "jitter")
    rows = [
        [f"bodysense, {BODY_TITLES[body]}", *(figure(numbers, f"three_point_{body}_{column}") for column in columns)]
        for body in BODIES
        if f"three_point_{body}_mpjpe_cm" in numbers
    ]
    for name, (_, position, velocity, jerk) in THREE_POINT.items():
        rows.append(
            [
                name,
                f"{position:.2f}",
                "–" if velocity is None else f"{velocity:.2f}",
                "–" if jerk is None else f"{jerk:.2f}",
            ]
        )
    return markdown(["three points", "MPJPE cm", "velocity cm/s", "jitter 10² m/s³"], rows)


def _sensors(name: str) -> str:
    return name.replace("_", " ")


def _position(name: str) -> str:
    return "occluded_mpjpe_cm" if SENSOR_SETS[name].camera else "mpjpe_cm"


MOUNTS = {"pelvis": "pelvis", "ankle": "ankles", "knee": "knees", "elbow": "elbows"}
STAGES = {
    "calibrated": "after the second: mean, max, cm",
    "bows": "after two bows",
    "squat": "a bow and a squat, knees and elbows tracked too",
}


def mounts(numbers: Numbers) -> str:
    """Errors of where joints are under their trackers, as motion refines them."""
    rows = [
        [
            title,
            *(
                f"{figure(numbers, f'{part}_{stage}_mean_cm', 1)}, {figure(numbers, f'{part}_{stage}_max_cm', 1)}"
                if f"{part}_{stage}_mean_cm" in numbers
                else "–"
                for stage in STAGES
            ),
        ]
        for part, title in MOUNTS.items()
    ]
    return markdown(["", *STAGES.values()], rows)


FINGERS = {
    "occluded": ("hidden from the headset's cameras", "the hand as last known"),
    "synthesised": ("of a tracked wrist alone", "the mean hand"),
}


def fingers(numbers: Numbers) -> str:
    """Fingers of people left out of training, relative to a baseline."""
    rows = [
        [
            title,
            *(figure(numbers, f"finger_{what}_ratio_foreign{ending}") for ending in ("", "_recorded_only")),
            baseline,
        ]
        for what, (title, baseline) in FINGERS.items()
    ]
    return markdown(["fingers", "with generated", "recorded alone", "baseline"], rows)


BLOCKS = (
    Block("README.md", "completion", completion, ("completion", "completion-takes")),
    Block(CARD, "completion", completion, ("completion", "completion-takes")),
    Block(CARD, "network", network, more=("validation",)),
    Block(BACKWARD_CARD, "network", backward_network),
    Block(JOINING_CARD, "network", joining_network, more=("validation",)),
    Block("docs/completion.md", "completion", completion_measures, ("completion",)),
    Block("docs/completion.md", "published", published, ("completion",)),
    Block("docs/completion.md", "takes", takes, ("completion-takes",)),
    Block("docs/completion.md", "mounts", mounts, ("mounts",)),
    Block("docs/completion.md", "fingers", fingers, ("fingers",)),
    Block("docs/evaluation.md", "sight", sight, ("completion",)),
    Block("docs/evaluation.md", "wearers", wearers, ("sight",)),
    Block("docs/evaluation.md", "scenes", scenes, ("scenes",)),
    Block("docs/files.md", "holes", holes, ("holes", "holes-fingers")),
)
