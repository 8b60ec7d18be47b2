import json
from pathlib import Path

import pytest

from haptic_fieldbus.api import plan
from haptic_fieldbus.planning.explain import explain
from haptic_fieldbus.scenes.catalogue import scene_names
from tests.cli.command import Command
from tests.eds.fixed_mapping import RPDOS, written

KEYS = [
    "mapped", "left_out", "assumed", "pdos", "registers", "bus_load", "delay_s", "ways", "couplings", "limits",
    "guards", "sign", "stability", "modules", "deadlines", "limit",
]  # fmt: skip


@pytest.mark.thorough("every scene of the library", quick=("wall", "sprung_mass", "virtual_shaft"))
@pytest.mark.parametrize("scene", scene_names())
def test_a_plan_is_explained_as_the_api_explains_it(scene: str, command: Command) -> None:
    finished = command("plan", scene)
    assert finished.status == 0
    assert finished.out.rstrip("\n") == explain(plan(scene))


@pytest.mark.thorough("every scene of the library", quick=("wall", "sprung_mass", "virtual_shaft"))
@pytest.mark.parametrize("scene", scene_names())
def test_the_json_object_of_a_plan_has_the_keys_of_the_contract(scene: str, command: Command) -> None:
    shown = json.loads(command("plan", scene, "--json").out)
    compiled = plan(scene)
    assert list(shown) == KEYS
    assert shown["mapped"] == list(compiled.mapped)
    assert all(set(each) == {"what", "why"} for each in shown["left_out"])
    assert [pdo["name"] for pdo in shown["pdos"]] == ["TPDO1", "RPDO1"] * len(compiled.axes)
    assert [each["name"] for each in shown["couplings"]] == [each.name for each in compiled.scene.couplings]
    assert shown["registers"] is None
    delay = shown["delay_s"]
    assert list(delay) == ["bus", "compute", "drive", "torque_loop", "total"]
    assert delay["total"] == pytest.approx(delay["bus"] + delay["compute"] + delay["drive"] + delay["torque_loop"])


@pytest.mark.thorough("starts several processes")
def test_the_plans_of_different_scenes_differ_in_what_is_imported(command: Command) -> None:
    modules = {scene: set(json.loads(command("plan", scene, "--json").out)["modules"]) for scene in scene_names()}
    assert modules["wall"] == {"haptic_fieldbus.scenes.wall", "haptic_fieldbus.cycle.standstill"}
    assert modules["damped_wall"] > modules["wall"]
    assert "haptic_fieldbus.numerics.integrators" in modules["sprung_mass"]


def test_a_plan_can_be_made_for_a_real_bus(command: Command) -> None:
    finished = command("plan", "wall", "--bus", "socketcan:can0@500000", "--drive", "generic_cia402", "--node", "5")
    assert finished.status in (0, 4)
    assert "Traceback" not in finished.err


class TestFixedMapping:
    """PDOs with read-only mappings, as in the file of `tests.eds.fixed_mapping`."""

    def test_the_plan_shows_the_vendors_pdos_and_their_cost(self, command: Command, tmp_path: Path) -> None:
        path = written(tmp_path)
        told = command("plan", "wall", "--drive", path).out
        for text in ("TPDO3 381h", "TPDO5 181h", "RPDO5 201h", "fixed mapping", "75 unneeded bits per period"):
            assert text in told
        rows = json.loads(command("plan", "wall", "--drive", path, "--json").out)["pdos"]
        assert [(row["name"], row["fixed"], row["not_needed"]) for row in rows] == [
            ("TPDO3", True, []), ("TPDO5", True, ["6041h:00 statusword"]), ("RPDO5", True, [])
        ]  # fmt: skip

    def test_an_insufficient_one_is_refused_with_the_missing_object(self, command: Command, tmp_path: Path) -> None:
        path = written(tmp_path, {number: maps for number, maps in RPDOS.items() if number != 5})
        done = command("plan", "wall", "--drive", path)
        assert done.status == 4
        assert "no active RPDO carries 6071h target torque" in done.err


def test_the_nominal_limits_are_printed_on_request(command: Command) -> None:
    short, long = command("plan", "wall").out, command("plan", "wall", "-v").out
    assert long.startswith(short.rstrip("\n"))
    assert "stability  passive\n           nominal: stable to 1492 N/m" in long
    assert long.rstrip("\n") == explain(plan("wall"), verbose=True)


def test_a_node_behind_a_drive_is_told_to_stand_apart(command: Command) -> None:
    refused = command("plan", "wall", "--drive", "epos4.eds@5")
    assert refused.status == 2
    assert "the node has an option of its own: --drive epos4.eds --node 5" in " ".join(refused.err.split())
