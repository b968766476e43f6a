from types import SimpleNamespace

import pytest

from firmware_py.common.records import (
    DeviceHealth,
    DeviceRole,
    DeviceState,
    HeadingSample,
    NorthReference,
    PowerSample,
)
from firmware_py.sensors.second_sensor import SecondSensor


@pytest.mark.parametrize(
    ("role", "sample"),
    [
        (DeviceRole.COMPASS_B, HeadingSample(1.0, 0.5, NorthReference.TRUE, temperature_c=9.0)),
        (DeviceRole.POWER_B, PowerSample(1.0, voltage_v=12.5)),
    ],
)
def test_samples_and_health_are_those_of_the_second_device(role, sample):
    times_s = []
    health = DeviceHealth(2.0, DeviceRole.COMPASS, DeviceState.RUNNING, 7, 1, "text")
    sensor = SimpleNamespace(
        fileno=lambda: 5, receive=times_s.append, poll=lambda: [sample, sample], health=lambda _now_s: health
    )
    second = SecondSensor(sensor, role)
    second.receive(3.0)
    assert (second.fileno(), times_s) == (5, [3.0])
    values = {name: getattr(sample, name) for name in sample.__struct_fields__}
    assert second.poll() == (type(sample)(**values | {"source": 1}),) * 2
    assert second.health(3.0) == DeviceHealth(2.0, role, DeviceState.RUNNING, 7, 1, "text")
