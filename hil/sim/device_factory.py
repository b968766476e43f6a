"""Creation of the emulated devices on the board, each with its own noise, phase and clock error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, Protocol, runtime_checkable

from firmware_py.registry import PackageError, Registry
from firmware_py.vehicle import DeviceEntry, Vehicle, read_device
from hil.devices.ais import AisEmulator
from hil.devices.emulator import INTERFACE, Device, DeviceContext, EmulatedDevice
from hil.devices.nmea_gps import Gaps, NmeaGpsEmulator
from hil.devices.vedirect import Kind as PowerKind
from hil.devices.vedirect import Plant, VeDirectEmulator
from hil.errors import UsageError
from hil.ship.disturbances import Supply, Vessels
from hil.ship.noise import Stream, generator
from hil.ship.power_plant import Place, PowerPlant
from hil.ship.traffic import OWN_MMSI
from hil.sim.world import START_LATITUDE_DEG, START_LONGITUDE_DEG, World

FREQUENCY_ERROR_PPM = 20.0  # spread of ordinary crystal oscillators
AIS_BAUD = 38_400
POSITION_RATE_HZ = 1.0


def _make_gps(context: DeviceContext) -> Device:
    receiver_options: dict[str, Any] = {}
    if (receiver := context.world.disturbances.receiver) is not None:
        receiver_options = {
            "velocity_noise_m_s": receiver.noise_m_s,
            "latency_s": receiver.latency_s,
            "velocity_filter_s": receiver.filter_s,
            "gaps": Gaps(receiver.lost, receiver.gap_s, context.gaps),
        }
    return NmeaGpsEmulator(
        context.world,
        context.rng,
        rate_hz=POSITION_RATE_HZ,
        phase_s=context.phase_s,
        frequency_error_ppm=context.frequency_error_ppm,
        baud=context.baud,
        **receiver_options,
    )


@runtime_checkable
class Monitor(Protocol):
    """A compass that also measures the battery, such as a flight controller."""

    battery: Plant | None


EMULATORS: Final = "rambler.emulators"  # group of entry points

# By the names of `rambler-hil run --compass` and `--servo`; packages add theirs by entry points such as `compass.acme`.
COMPASSES: Registry[EmulatedDevice] = Registry(
    EMULATORS,
    "compass",
    {
        "nmea": "hil.devices.nmea_compass:EMULATOR",
        "pni": "hil.devices.pni_tcm:EMULATOR",
        "mti": "hil.devices.mti:EMULATOR",
        "rion": "hil.devices.rion:EMULATOR",
        "witmotion": "hil.devices.witmotion:EMULATOR",
        "bno08x_rvc": "hil.devices.bno08x_rvc:EMULATOR",
        "mavlink": "hil.devices.mavlink_board:EMULATOR",
        "nmea2000": "hil.devices.nmea2000:EMULATOR",
    },
    EmulatedDevice,
    INTERFACE,
)
SERVOS: Registry[EmulatedDevice] = Registry(
    EMULATORS,
    "servo",
    {
        "dynamixel": "hil.devices.dynamixel:EMULATOR",
        "volz": "hil.devices.volz:EMULATOR",
        "feetech": "hil.devices.feetech:EMULATOR",
        "maestro": "hil.devices.maestro:EMULATOR",
        "pwm": "hil.devices.pwm:EMULATOR",
    },
    EmulatedDevice,
    INTERFACE,
)
# Sensors that a vehicle may have, by section and driver; a scenario with the disturbance of that name adds them.
INSTRUMENTS: Mapping[str, Registry[EmulatedDevice]] = {
    name: Registry(
        EMULATORS,
        name,
        {"nmea": f"hil.devices.nmea_{name}:EMULATOR", "nmea2000": f"hil.devices.nmea2000_instruments:{name.upper()}"},
        EmulatedDevice,
        INTERFACE,
    )
    for name in ("wind", "depth")
}
RUDDER_ANGLES: Registry[EmulatedDevice] = Registry(
    EMULATORS,
    "rudder_angle",
    {"nmea": "hil.devices.nmea_rudder:EMULATOR", "nmea2000": "hil.devices.nmea2000_instruments:RUDDER_ANGLE"},
    EmulatedDevice,
    INTERFACE,
)
POSITION = EmulatedDevice(interface=INTERFACE, driver="nmea", baud=9600, make=_make_gps)
POWER_DRIVER, POWER_BAUD = "vedirect", 19200


def find_device(devices: Registry[EmulatedDevice], name: str) -> EmulatedDevice:
    """Return the emulated device with this name; raise UsageError if its package cannot be used."""
    try:
        return devices[name]
    except PackageError as error:
        raise UsageError(str(error)) from None


def _find_device_of(devices: Registry[EmulatedDevice], driver: str) -> EmulatedDevice:
    """Return the emulated device of a driver; raise UsageError if there is none."""
    for name in devices:
        if (device := find_device(devices, name)).driver == driver:
            return device
    drivers = ", ".join(device.driver for device in devices.values())
    section = "rudder" if devices is SERVOS else devices.kind
    raise UsageError(f"[{section}] driver {driver!r} has no emulated device; use one of {drivers}")


def shared_sections(vehicle: Vehicle) -> tuple[str, ...]:
    """Return the further sections that the emulated compass of a vehicle serves on its port."""
    return _find_device_of(COMPASSES, vehicle.compass.driver).shared_by


def instrument_entry(vehicle: Vehicle, name: str) -> DeviceEntry:
    """Return the section of wind sensor or echo sounder of a vehicle, or that of an NMEA sensor."""
    entry: DeviceEntry | None = getattr(vehicle, name)
    if entry is not None:
        return entry
    values = {"driver": "nmea", "port": "set by the board", "baud": INSTRUMENTS[name]["nmea"].baud}
    return read_device(name, values, f"[{name}]")


def make_emulators(world: World, vehicle: Vehicle, seed: int) -> dict[str, Device]:
    """Create the devices of a vehicle; raise UsageError if that fails.

    The declination is the one in the vehicle file. A vehicle without a power monitor gets a charger and a monitor if
    the scenario has the disturbance `supply`, one without AIS a transponder if it has `vessels`, and likewise a wind
    sensor and an echo sounder. A compass that serves further sections (`shared_by`) is the only device for them.
    """
    rng = generator(seed, Stream.PHASES)
    compass, rudder = vehicle.compass, vehicle.rudder

    def context(baud: int, options: Any, stream: Stream, period_s: float) -> DeviceContext:
        return DeviceContext(
            world,
            baud,
            options,
            generator(seed, stream),
            phase_s=float(rng.uniform(0.0, period_s)),
            frequency_error_ppm=float(rng.normal(0.0, FREQUENCY_ERROR_PPM)),
            declination_deg=vehicle.parameters.get("CMP_DECL_DEG", 0.0),
            gaps=generator(seed, Stream.GAPS),
        )

    compass_device, servo = _find_device_of(COMPASSES, compass.driver), _find_device_of(SERVOS, rudder.driver)
    try:
        devices: dict[str, Device] = {
            "compass": compass_device.make(context(compass.baud, compass.options, Stream.COMPASS, 0.1)),
            "position": POSITION.make(context(POSITION.baud, None, Stream.POSITION, 1.0)),
            "rudder": servo.make(context(rudder.baud, rudder.options, Stream.RUDDER, 1.0)),
        }
        if (second := vehicle.compass_b) is not None:
            device = _find_device_of(COMPASSES, second.driver)
            devices["compass_b"] = device.make(context(second.baud, second.options, Stream.COMPASS_B, 0.1))
        if (sensor := vehicle.rudder_angle) is not None:
            device = _find_device_of(RUDDER_ANGLES, sensor.driver)
            devices["rudder_angle"] = device.make(context(sensor.baud, sensor.options, Stream.RUDDER_ANGLE, 0.1))
        supply = _make_power(world, vehicle, devices, compass_device.shared_by, seed)
        devices = {name: device for name, device in devices.items() if name not in compass_device.shared_by}
        devices |= supply | _make_ais(world, vehicle, seed)
        for name, stream in (("wind", Stream.WIND), ("depth", Stream.DEPTH)):
            if getattr(vehicle, name) is not None or getattr(world.disturbances, name) is not None:
                entry = instrument_entry(vehicle, name)
                instrument = _find_device_of(INSTRUMENTS[name], entry.driver)
                devices[name] = instrument.make(context(entry.baud, entry.options, stream, 1.0))
    except ValueError as error:
        raise UsageError(f"vehicle file: a device cannot be emulated: {error}") from None
    return devices


def _make_power(
    world: World, vehicle: Vehicle, devices: Mapping[str, Device], shared_by: Sequence[str], seed: int
) -> dict[str, Device]:
    """Create the supply devices: one charger with all loads, or a charger and a monitor.

    The compass is the monitor if it serves the section power (`shared_by`).
    """
    supply = world.disturbances.supply
    compass, servo = devices["compass"], devices["rudder"]
    entries = {"power": vehicle.power, "power_b": vehicle.power_b}
    entries = {name: entry for name, entry in entries.items() if name not in shared_by}
    configured = [name for name, entry in entries.items() if entry is not None]
    if supply is None and not configured:
        return {}
    place = Place(START_LATITUDE_DEG, START_LONGITUDE_DEG, world.utc_s() - world.now_s)
    plant = PowerPlant(supply or Supply(), place, generator(seed, Stream.CLOUDS), lambda: used_energy_j(servo))
    rng = generator(seed, Stream.POWER)
    names = configured or list(entries)
    has_monitor = len(names) > 1 or "power" in shared_by
    if isinstance(compass, Monitor):
        compass.battery = plant
    return {
        name: VeDirectEmulator(
            plant,
            PowerKind.MONITOR if number else PowerKind.CHARGER if has_monitor else PowerKind.CHARGER_WITH_LOAD,
            phase_s=float(rng.uniform(0.0, 1.0)),
            frequency_error_ppm=float(rng.normal(0.0, FREQUENCY_ERROR_PPM)),
            baud=POWER_BAUD,
        )
        for number, name in enumerate(names)
    }


def _make_ais(world: World, vehicle: Vehicle, seed: int) -> dict[str, Device]:
    """Create the AIS transponder if the vehicle has one or the scenario has other ships."""
    vessels = world.disturbances.vessels
    if vessels is None and vehicle.ais is None:
        return {}
    options = vessels or Vessels()
    own_mmsi = (vehicle.ais.options.own_mmsi if vehicle.ais is not None else 0) or OWN_MMSI
    transponder = AisEmulator(
        world,
        (START_LATITUDE_DEG, START_LONGITUDE_DEG),
        [replace(ship, mmsi=own_mmsi) if ship.mmsi == OWN_MMSI else ship for ship in world.ships],
        generator(seed, Stream.AIR),
        own_mmsi=own_mmsi,
        range_m=1e3 * options.range_km,
        lost=options.lost,
        baud=AIS_BAUD,
    )
    return {"ais": transponder}


def used_energy_j(servo: Device) -> float:
    """Return the energy that an emulated servo has used so far."""
    return float(getattr(servo, "energy_j", 0.0))
