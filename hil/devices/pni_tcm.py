"""A PNI TCM compass module, which sends on request or continuously.

Source: PNI TCM User Manual (binary protocol) and its examples. The manual defines no error reply: a frame with a bad
CRC, an unknown id or a value out of range is ignored.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from firmware_py.common.angles import degrees
from hil.devices.emulator import INTERFACE, Attitude, Device, DeviceContext, EmulatedDevice
from hil.devices.nmea_text import bearing
from hil.devices.pni_calibration import ABORTED_SCORE, OPTIONS, UserCalibration
from hil.devices.pni_frames import SETTINGS, Config, Frame, FrameReader, ModuleSettings, pack_frame
from hil.devices.timing import Pace, Transmitter

_MIN_INTERVAL_S = 1.0 / 30.0  # the module samples at up to 30 Hz
_MAX_INTERVAL_S = 3600.0
_MILS_PER_DEGREE = 6400.0 / 360.0
_REPLY_DELAY_S = 0.002
_MODULE_TYPE, _REVISION = b"TCM5", b"1208"  # the example of the manual
_FIELD_HORIZONTAL_UT, _FIELD_DOWN_UT = 20.0, 43.0  # a mid-latitude field


class PniTcmEmulator:
    """A TCM with the commands of the PNI TCM manual, and with continuous output when configured and started.

    `declination_deg` is that of the location: the module measures magnetic north and adds its configured declination
    only if true north is configured. `push_mode` is the acquisition mode for continuous output: 0 on TCM3, TCM5 and
    Prime (PollingMode false), 1 in the later manuals (AcquisitionMode continuous). `temperature_c`, `pitch_deg`,
    `roll_deg` and `distorted` may be set at any time.
    """

    def __init__(
        self,
        attitude: Attitude,
        rng: np.random.Generator,
        *,
        noise_deg: float = 0.3,
        resolution_deg: float = 0.1,
        tilt_noise_deg: float = 0.2,
        declination_deg: float = 0.0,
        frequency_error_ppm: float = 0.0,
        push_mode: int = 0,
        boot_s: float = 0.3,
        baud: int = 38400,
    ) -> None:
        """Start powered with factory settings."""
        self.temperature_c = 20.0
        self.pitch_deg = 0.0
        self.roll_deg = 0.0
        self.distorted = False
        self.calibration_score = 0.6  # of the next user calibration
        self.calibrated = False  # True after a calibration was saved
        self._calibration: UserCalibration | None = None
        self._has_score = False
        self._attitude = attitude
        self._rng = rng
        self._noise_deg = noise_deg
        self._resolution_deg = resolution_deg
        self._tilt_noise_deg = tilt_noise_deg
        self._declination_deg = declination_deg
        self._error_ppm = frequency_error_ppm
        self._push_mode = push_mode
        self._boot_s = boot_s
        self.transmitter = Transmitter(baud)
        self._reader = FrameReader()
        self._saved = ModuleSettings()
        self._settings = self._saved
        self._pace: Pace | None = None
        self._ready_s = -math.inf
        self._is_asleep = False
        self._commands = self._command_table()
        self._components = self._component_table()

    def receive(self, now_s: float, data: bytes) -> None:
        """Process commands; any byte wakes a sleeping module and is lost."""
        if now_s < self._ready_s or not data:
            return
        if self._is_asleep:
            self._wake(now_s)
            return
        for frame, payload in self._reader.feed(now_s, data):
            command = self._commands.get(frame)
            if command is not None and not self._is_asleep:
                command(now_s, payload)

    def next_output_s(self) -> float:
        """Return when the next output is sampled or the next frame is complete."""
        output_s = math.inf if self._pace is None else self._pace.next_s
        sample_s = math.inf if self._calibration is None else self._calibration.next_s
        return min(output_s, sample_s, self.transmitter.next_s())

    def take_output(self, now_s: float) -> bytes:
        """Take the samples that are due and return the complete frames."""
        while self._calibration is not None and self._calibration.next_s <= now_s:
            self._sample_calibration(self._calibration)
        if self._pace is not None:
            for sample_s in self._pace.take(now_s):
                self.transmitter.send(sample_s, self._data_frame())
        return self.transmitter.take(now_s)

    def power_cycle(self, now_s: float, off_s: float = 1.0) -> None:
        """Interrupt the power for off_s (infinity: until the next call); unsaved settings are lost."""
        self.transmitter.clear()
        self._reader.clear()
        self._is_asleep = False
        self._restart(now_s + off_s)

    # ------------------------------------------------------------------ commands

    def _command_table(self) -> dict[int, Callable[[float, bytes], None]]:
        return {
            Frame.GET_MOD_INFO: self._get_mod_info,
            Frame.SET_DATA_COMPONENTS: self._set_data_components,
            Frame.GET_DATA: self._get_data,
            Frame.SET_CONFIG: self._set_config,
            Frame.GET_CONFIG: self._get_config,
            Frame.SAVE: self._save,
            Frame.START_CAL: self._start_cal,
            Frame.STOP_CAL: self._stop_cal,
            Frame.POWER_DOWN: self._power_down,
            Frame.START_CONTINUOUS: self._start_continuous,
            Frame.STOP_CONTINUOUS: self._stop_continuous,
            Frame.SET_ACQ_PARAMS: self._set_acq_params,
            Frame.GET_ACQ_PARAMS: self._get_acq_params,
        }

    def _get_mod_info(self, now_s: float, payload: bytes) -> None:
        if not payload:
            self._reply(now_s, Frame.MOD_INFO_RESP, _MODULE_TYPE + _REVISION)

    def _set_data_components(self, now_s: float, payload: bytes) -> None:
        components = tuple(payload[1:])
        if payload and payload[0] == len(components) and all(key in self._components for key in components):
            self._settings = replace(self._settings, components=components)
            self._restart_output(now_s)

    def _get_data(self, now_s: float, payload: bytes) -> None:
        if not payload:
            self.transmitter.send(now_s + _REPLY_DELAY_S, self._data_frame())

    def _set_config(self, now_s: float, payload: bytes) -> None:
        setting = SETTINGS.get(payload[0]) if payload else None
        if setting is None:
            return
        value = self._settings.unpack(setting.code, payload[1:])
        if value is not None and setting.low <= value[0] <= setting.high:
            self._settings = replace(self._settings, config={**self._settings.config, payload[0]: value[0]})
            self._reply(now_s, Frame.SET_CONFIG_DONE)

    def _get_config(self, now_s: float, payload: bytes) -> None:
        setting = SETTINGS.get(payload[0]) if len(payload) == 1 else None
        if setting is not None:
            value = self._settings.pack(setting.code, self._settings.config[payload[0]])
            self._reply(now_s, Frame.CONFIG_RESP, payload + value)

    def _save(self, now_s: float, payload: bytes) -> None:
        if not payload:
            self._saved = self._settings
            self.calibrated |= self._has_score
            self._reply(now_s, Frame.SAVE_DONE, self._settings.pack("H", 0))

    def _start_cal(self, now_s: float, payload: bytes) -> None:
        option = self._settings.unpack("I", payload)
        if option is not None and option[0] in OPTIONS and self._settings.config[Config.AUTOMATIC]:
            points = int(self._settings.config[Config.POINTS])
            self._calibration = UserCalibration(now_s, points, self.calibration_score)
            self._has_score = False

    def _stop_cal(self, now_s: float, payload: bytes) -> None:
        if not payload and self._calibration is not None:
            self._send_score(now_s, ABORTED_SCORE)

    def _sample_calibration(self, calibration: UserCalibration) -> None:
        sample_s = calibration.next_s
        count, score = calibration.update(degrees(self._magnetic_rad()))
        if count is not None:
            self._reply(sample_s, Frame.CAL_SAMPLE_COUNT, self._settings.pack("I", count))
        if score is not None:
            self._has_score = True
            self._send_score(sample_s, score)

    def _send_score(self, now_s: float, score: float) -> None:
        self._calibration = None
        # Magnetometer score, reserved, accelerometer score (none), distribution and tilt errors, tilt range.
        self._reply(now_s, Frame.CAL_SCORE, self._settings.pack("ffffff", score, 0.0, 99.99, 0.1, 0.1, 1.0))

    def _set_acq_params(self, now_s: float, payload: bytes) -> None:
        values = self._settings.unpack("BBff", payload)
        if values is None:
            return
        mode, flush, acquire_s, interval_s = values
        if mode in (0, 1) and flush in (0, 1) and all(0.0 <= x <= _MAX_INTERVAL_S for x in (acquire_s, interval_s)):
            self._settings = replace(
                self._settings, mode=int(mode), flush=int(flush), acquire_s=acquire_s, interval_s=interval_s
            )
            self._restart_output(now_s)
            self._reply(now_s, Frame.SET_ACQ_PARAMS_DONE)

    def _get_acq_params(self, now_s: float, payload: bytes) -> None:
        if not payload:
            settings = self._settings
            packed = self._settings.pack("BBff", settings.mode, settings.flush, settings.acquire_s, settings.interval_s)
            self._reply(now_s, Frame.ACQ_PARAMS_RESP, packed)

    def _start_continuous(self, now_s: float, payload: bytes) -> None:
        if not payload:
            self._settings = replace(self._settings, is_continuous=True)
            self._restart_output(now_s)

    def _stop_continuous(self, now_s: float, payload: bytes) -> None:
        if not payload:
            self._settings = replace(self._settings, is_continuous=False)
            self._restart_output(now_s)

    def _power_down(self, now_s: float, payload: bytes) -> None:
        if not payload:
            self._reply(now_s, Frame.POWER_DOWN_DONE)
            self._is_asleep = True
            self._pace = None

    # ------------------------------------------------------------------ measurement and output

    def _component_table(self) -> dict[int, tuple[str, Callable[[], float]]]:
        """Return format and measurement by component id; axes are x ahead, y to starboard, z down."""
        return {
            5: ("f", lambda: self._in_configured_unit(self._heading_deg())),  # kHeading
            7: ("f", lambda: self.temperature_c + self._noise(0.05)),  # kTemperature
            8: ("B", lambda: int(self.distorted)),  # kDistortion
            9: ("B", lambda: 1),  # kCalStatus: user calibration is done
            # Acceleration [g] along x, y and z.
            21: ("f", lambda: -math.sin(math.radians(self.pitch_deg)) + self._noise(0.002)),
            22: ("f", lambda: math.sin(math.radians(self.roll_deg)) + self._noise(0.002)),
            23: ("f", lambda: 1.0 + self._noise(0.002)),
            # Pitch and roll.
            24: ("f", lambda: self._in_configured_unit(self.pitch_deg + self._noise(self._tilt_noise_deg))),
            25: ("f", lambda: self._in_configured_unit(self.roll_deg + self._noise(self._tilt_noise_deg))),
            # Magnetic field [microtesla] along x, y and z.
            27: ("f", lambda: _FIELD_HORIZONTAL_UT * math.cos(self._magnetic_rad()) + self._noise(0.05)),
            28: ("f", lambda: -_FIELD_HORIZONTAL_UT * math.sin(self._magnetic_rad()) + self._noise(0.05)),
            29: ("f", lambda: _FIELD_DOWN_UT + self._noise(0.05)),
        }

    def _wake(self, now_s: float) -> None:
        """Restart from the saved settings; the line, held low in sleep, produces one stray byte first."""
        self._is_asleep = False
        self._reader.clear()
        self._restart(now_s)
        self.transmitter.send(self._ready_s, b"\x00" + pack_frame(Frame.POWER_UP_DONE))

    def _restart(self, power_s: float) -> None:
        self._ready_s = power_s + self._boot_s
        self._settings = self._saved
        self._calibration = None
        self._has_score = False
        self._restart_output(self._ready_s)

    def _restart_output(self, now_s: float) -> None:
        """Start or stop continuous output at now_s as configured."""
        settings = self._settings
        if not (
            settings.is_continuous and settings.mode == self._push_mode and settings.components and math.isfinite(now_s)
        ):
            self._pace = None
            return
        period_s = max(settings.interval_s, _MIN_INTERVAL_S)
        self._pace = Pace(period_s, start_s=now_s + period_s, error_ppm=self._error_ppm)

    def _reply(self, now_s: float, frame: Frame, payload: bytes = b"") -> None:
        self.transmitter.send(now_s + _REPLY_DELAY_S, pack_frame(frame, payload))

    def _data_frame(self) -> bytes:
        payload = bytes([len(self._settings.components)])
        for key in self._settings.components:
            code, measure = self._components[key]
            payload += bytes([key]) + self._settings.pack(code, measure())
        return pack_frame(Frame.DATA_RESP, payload)

    def _in_configured_unit(self, angle_deg: float) -> float:
        return angle_deg * _MILS_PER_DEGREE if self._settings.config[Config.MILS] else angle_deg

    def _noise(self, deviation: float) -> float:
        return self._rng.normal(0.0, deviation)

    def _magnetic_rad(self) -> float:
        return self._attitude.heading_rad() - math.radians(self._declination_deg)

    def _heading_deg(self) -> float:
        angle_deg = degrees(self._magnetic_rad()) + self._noise(self._noise_deg)
        if self._settings.config[Config.TRUE_NORTH]:
            angle_deg += self._settings.config[Config.DECLINATION]
        return bearing(angle_deg, self._resolution_deg)


def _make(context: DeviceContext) -> Device:
    return PniTcmEmulator(
        context.world,
        context.rng,
        declination_deg=context.declination_deg,
        frequency_error_ppm=context.frequency_error_ppm,
        baud=context.baud,
    )


EMULATOR = EmulatedDevice(interface=INTERFACE, driver="pni_tcm", baud=38400, make=_make)
