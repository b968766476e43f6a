"""Wind sensor and echo sounder with the real program in lockstep: silence, faults with their actions, log, status."""

from firmware_py.log.reader import read_log
from hil.ship.disturbances import Depth, Wind
from support.harness import is_replay_identical

GUIDED = 15
LIMITS = {"DEPTH_MIN": 20.0, "FS_DEPTH_ACT": 2, "FS_RESUME": 1}


def test_silent_sensors_are_reported_and_shallow_water_keeps_the_heading(fault_bench):
    bench = fault_bench(goals="0:30", settings=LIMITS, instruments=(Wind(9.0, 200.0), Depth(50.0)))
    bench.get_under_way(GUIDED)
    bench.wind.silent = bench.depth.silent = True
    bench.run_until_text("Wind sensor: no data", 25.0)
    bench.run_until_text("Depth sensor: no data", 2.0, since_s=0.0)
    assert bench.mode() == "GUIDED"
    bench.wind.silent = bench.depth.silent = False
    bench.run_until_text("Wind sensor: data recovered", 3.0)
    bench.run_until_text("Depth sensor: data recovered", 2.0, since_s=0.0)
    bench.world.start_depth_m = 15.0
    bench.run_until_text("Water shallow: depth below DEPTH_MIN", 13.0)
    assert bench.mode() == "STEERING"
    bench.world.start_depth_m = 30.0
    bench.run_until_text("Water no longer shallow", 33.0)
    assert bench.mode() == "GUIDED"
    assert not any("Disarmed" in text for text in bench.texts_since(0.0))
    (log,) = bench.finish()
    ticks = list(read_log(log))
    depths = [sample.depth_m for tick in ticks for sample in tick.inputs.depth]
    winds = [sample.wind_m_s for tick in ticks for sample in tick.inputs.wind]
    assert len(depths) > 40
    assert len(winds) > 40
    assert min(depths) < 15.2
    assert max(depths) > 49.8
    assert 4.0 < min(winds) < max(winds) < 14.0
    assert is_replay_identical(bench.directory)
