"""Tracker noise: errors of headsets, controllers, cameras and IMUs, as a disturbance of an observation.

The model of a headset was fitted, band by band, to Quest 2 and Quest Pro against a robot arm's encoders, up to 0.5 m/s
and 100 °/s. Its error is a drift over the travelled distance, not over time: first-order autoregressive in metres, with
a deviation that grows with speed. There is also a slow drift at rest, a wobble at some 5 Hz in motion, and almost no
white noise. Everything else here is an assumption: controllers and worn trackers have larger errors of the same kind;
joints seen by cameras are off by millimetres for a fraction of a second; IMUs lose their heading.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle, quaternion_canonical, quaternion_exp, quaternion_multiply
from bodysense.observing.observation import Observation

MEAN_NORM = (8 / np.pi) ** 0.5  # mean length of a normal vector in space, in deviations along one axis
_LATEST_STAMP = 0.3  # of the shortest interval: larger jitter of stamps is clipped, so that times increase


@dataclass(frozen=True)
class DriftModel:
    """Standard deviations along each axis, of a position (m, speed in m/s) or of a rotation (°, speed in °/s)."""

    drift: float  # drift over the travelled distance, at speed 0
    drift_per_speed: float  # its growth with speed
    rest: float  # drift over time
    wobble_per_speed: float
    wobble_rate: float  # Hz
    white: float  # white noise at rest
    white_moving: float  # white noise in motion
    moving: float  # speed above which a point counts as moving


POSITION = DriftModel(
    drift=0.8 * 0.37e-3,
    drift_per_speed=0.8 * 1.2e-3,
    rest=0.145e-3,
    wobble_per_speed=0.65e-3,
    wobble_rate=5.0,
    white=0.0002e-3,
    white_moving=0.010e-3,
    moving=0.02,
)
ROTATION = DriftModel(
    drift=0.8 * 0.014,
    drift_per_speed=0.8 * 0.0014,
    rest=0.003,
    wobble_per_speed=0.0012,
    wobble_rate=4.0,
    white=0.0003,
    white_moving=0.0025,
    moving=2.0,
)
_PATH = 0.30  # m, correlation length of the drift over the travelled distance
_SMOOTH = 0.06  # s, time constant of the smoothing of this drift
_REST_TIME = 4.0  # s, correlation time of the drift at rest
_DAMPING = 0.9  # damping ratio of the wobble
_USUAL_SPEED = 0.5  # m/s, speed for the stated accuracy of a point


@dataclass(frozen=True)
class NoiseSettings:
    """Kinds and sizes of errors. The head is a headset; points with rotation only are IMUs."""

    headset: float = 1.0  # factor on the fitted model
    trackers: float = 2.5  # factor on the fitted model for controllers and worn trackers
    cameras: bool = False  # whether cameras see all positions except the head's, and their rotations
    camera_position: tuple[float, float] = (0.003, 0.008)  # m in space, range from which each session draws
    camera_rotation: tuple[float, float] = (2.0, 5.0)  # ° in space, range from which each session draws
    camera_time: float = 0.3  # s, correlation time of a camera's errors
    imu_heading: float = 3.0  # ° about the vertical
    imu_tilt: float = 0.7  # ° about the other axes
    imu_time: float = 60.0  # s, correlation time of an IMU's errors
    imu_acceleration: float = (
        0.15  # m/s² along each axis, of white noise and of an offset that is constant in a session
    )
    scale: float = 0.003  # deviation of the whole map's scale, drawn for a session
    stamp_jitter: float = 0.0004  # s, deviation of the time stamps

    def __post_init__(self) -> None:
        for name in ("headset", "trackers", "imu_heading", "imu_tilt", "imu_acceleration", "scale", "stamp_jitter"):
            if not 0 <= getattr(self, name) < np.inf:
                raise BodysenseError(f"noise settings: {name} is {getattr(self, name):g}; give 0 or more")
        for name in ("camera_time", "imu_time"):
            if not getattr(self, name) > 0:
                raise BodysenseError(f"noise settings: {name} is {getattr(self, name):g} s; it must be positive")


def disturb(
    observation: Observation, rng: np.random.Generator, settings: NoiseSettings = NoiseSettings()
) -> Observation:
    """Add realistic errors to an observation (..., T, P); every batch entry is a session with independent errors.

    Accuracies are those of the disturbed points. Errors of hidden points continue. All sessions share the times, which
    jitter, too, and still increase.
    """
    # Intervals (T,) s, and metres and degrees (..., T, P) since the frame before, 0 if unknown; the first frame's are
    # the second's.
    interval = np.full(len(observation), 1 / 72)
    if len(observation) > 1:
        interval[1:] = np.diff(observation.time)
        interval[0] = interval[1]
    is_head = np.array([name == "head" for name in observation.points])
    rotation = observation.rotation
    metres = _first_repeated(np.linalg.norm(np.diff(observation.position, axis=-3), axis=-1))
    turned = _first_repeated(np.degrees(geodesic_angle(rotation[..., 1:, :, :], rotation[..., :-1, :, :])))
    imu = np.asarray(observation.has_rotation.any(axis=-2) & ~observation.has_position.any(axis=-2))
    seen = ~(is_head | imu) & settings.cameras
    factor = np.where(is_head, settings.headset, settings.trackers) * ~(imu | seen)

    shift = _fitted_errors(POSITION, metres / interval[:, None], metres, interval, factor, rng)
    turn = _fitted_errors(ROTATION, turned / interval[:, None], metres, interval, factor, rng)
    session = imu.shape[:-1]
    blur = rng.uniform(*settings.camera_position, session)[..., None] * seen / np.sqrt(3)
    spin = rng.uniform(*settings.camera_rotation, session)[..., None] * seen / np.sqrt(3)
    lean = imu[..., None] * np.array([settings.imu_tilt, settings.imu_heading, settings.imu_tilt])
    if settings.cameras:
        shift += _drift(blur[..., None] * np.ones(3), settings.camera_time, interval, rng)
        turn += _drift(spin[..., None] * np.ones(3), settings.camera_time, interval, rng)
    if imu.any():
        turn += _drift(lean, settings.imu_time, interval, rng)

    # Sessions begin on the floor below the head's first known position, at the origin if it is never known.
    head = observation.position[..., int(is_head.argmax()), :]
    first = np.isfinite(head).all(axis=-1).argmax(axis=-1)
    start = np.take_along_axis(head, first[..., None, None], axis=-2)
    origin = (np.nan_to_num(start) * np.array([1.0, 0.0, 1.0]))[..., None, :]
    scale = 1 + settings.scale * rng.standard_normal((*session, 1, 1, 1))
    position = origin + scale * (observation.position - origin) + shift
    rotation = quaternion_multiply(quaternion_exp(np.radians(turn)), observation.rotation)
    usual = factor * (POSITION.drift + POSITION.drift_per_speed * _USUAL_SPEED) + blur
    accuracy = np.hypot(observation.accuracy, (MEAN_NORM * usual)[..., None, :])
    jitter = settings.stamp_jitter * rng.standard_normal(len(observation))
    latest = _LATEST_STAMP * interval.min()
    felt = observation.acceleration
    if felt is not None:
        white = rng.standard_normal(felt.shape) + rng.standard_normal((*session, 1, *felt.shape[-2:]))
        felt = felt + settings.imu_acceleration * white
    return replace(
        observation,
        position=np.where(observation.has_position[..., None], position, np.nan),
        rotation=np.where(observation.has_rotation[..., None], quaternion_canonical(rotation), np.nan),
        accuracy=accuracy,
        time=observation.time + np.clip(jitter, -latest, latest),
        acceleration=felt,
    )


def _first_repeated(step: np.ndarray) -> np.ndarray:
    """Return (..., T, P): differences (..., T − 1, P) with the first one repeated, and 0 instead of NaN."""
    first = step[..., :1, :] if step.shape[-2] else np.zeros((*step.shape[:-2], 1, step.shape[-1]))
    return np.nan_to_num(np.concatenate([first, step], axis=-2))


def _drift(deviation: np.ndarray, time: float, interval: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return (..., T, P, 3): first-order drift of constant deviation (..., P, 3) with the correlation time `time` s."""
    drift, frames = deviation * rng.standard_normal(deviation.shape), []
    for gap in interval:
        keep = np.exp(-gap / time)
        drift = keep * drift + np.sqrt(1 - keep**2) * deviation * rng.standard_normal(deviation.shape)
        frames.append(drift)
    return np.stack(frames, axis=-3)


def _fitted_errors(
    model: DriftModel,
    speed: np.ndarray,
    metres: np.ndarray,
    interval: np.ndarray,
    factor: np.ndarray,
    rng: np.random.Generator,
) -> np.ndarray:
    """Return errors (..., T, P, 3) of the fitted model at speeds and distances (..., T, P), times `factor` (..., P)."""
    speed, metres = np.moveaxis(speed, -2, 0)[..., None], np.moveaxis(metres, -2, 0)[..., None]
    drift_sigma = model.drift + model.drift_per_speed * speed
    white_sigma = np.where(speed > model.moving, model.white_moving, model.white)
    shape = (*speed.shape[1:-1], 3)
    drift = drift_sigma[0] * rng.standard_normal(shape)
    smooth, wobble, before = drift, np.zeros(shape), np.zeros(shape)
    rest = model.rest * rng.standard_normal(shape)
    frames = []
    for now, gap in enumerate(interval):
        fresh = rng.standard_normal((4, *shape))
        keep = np.exp(-metres[now] / _PATH)
        drift = keep * drift + np.sqrt(1 - keep**2) * drift_sigma[now] * fresh[0]
        smooth = smooth + (1 - np.exp(-gap / _SMOOTH)) * (drift - smooth)
        keep = np.exp(-gap / _REST_TIME)
        rest = keep * rest + np.sqrt(1 - keep**2) * model.rest * fresh[1]
        last, lag, share = _oscillator(model.wobble_rate, gap)
        wobble, before = last * wobble + lag * before + share * model.wobble_per_speed * speed[now] * fresh[2], wobble
        frames.append(smooth + rest + wobble + white_sigma[now] * fresh[3])
    return np.stack(frames, axis=-3) * np.asarray(factor)[..., None, :, None]


def _oscillator(rate: float, gap: float) -> tuple[float, float, float]:
    """Return weights of the last two values and of the noise, for a wobble at `rate` Hz with a deviation of 1."""
    decay = np.exp(-_DAMPING * 2 * np.pi * rate * gap)
    last, lag = 2 * decay * np.cos(np.sqrt(1 - _DAMPING**2) * 2 * np.pi * rate * gap), -(decay**2)
    variance = (1 - lag) / ((1 + lag) * ((1 - lag) ** 2 - last**2))
    return float(last), float(lag), float(variance**-0.5)


def hide(observation: Observation, hidden: np.ndarray) -> Observation:
    """Hide points by the mask `hidden` (..., T, P); their values become NaN."""
    felt = observation.acceleration
    return replace(
        observation,
        position=np.where(hidden[..., None], np.nan, observation.position),
        rotation=np.where(hidden[..., None], np.nan, observation.rotation),
        has_position=observation.has_position & ~hidden,
        has_rotation=observation.has_rotation & ~hidden,
        acceleration=felt if felt is None else np.where(hidden[..., None], np.nan, felt),
    )
