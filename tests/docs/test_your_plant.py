"""The file that the guide on plants shows is a plant, and is sound."""

from __future__ import annotations

from hoopd.plants.plant_check import checks
from hoopd.plants.plant_file import parse_plant
from tests.docs.marks import ROOT, blocks

PAGE = ROOT / "docs" / "guides" / "your_plant.md"


def test_the_page_s_file_is_a_sound_plant() -> None:
    (file,) = (block for block in blocks(PAGE) if block.save)
    plant = parse_plant(file.text, file.save)
    assert plant.free == ("m", "b") and list(plant.channels) == ["x"]
    assert [check for check in checks(plant) if check.good is False] == []
