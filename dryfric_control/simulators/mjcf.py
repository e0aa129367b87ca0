"""An MJCF file: its joints with what their classes give them, and edits of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from dryfric_control.simulators import files, mujoco_formats
from dryfric_control.simulators.files import Edit, Element
from dryfric_control.simulators.mujoco_formats import Stepping
from dryfric_control.text import page_reference


class Mjcf:
    """Joints of the bodies of an MJCF file by name."""

    def __init__(self, path: Path, raw: bytes) -> None:
        self.raw = raw
        self.tags = files.elements(path, raw, "MJCF", "mujoco")
        self.joints = {
            one.attributes["name"]: one
            for one in self.tags
            if one.name == "joint" and "name" in one.attributes and "worldbody" in one.path
        }
        if self.joints:
            return
        others = [one.attributes.get("file", "") for one in self.tags if one.name == "include"]
        mend = f"give the included file with them ({', '.join(others)})" if others else "name them"
        raise ValueError(
            f"model {path.name} has no joint with a name in a body: {mend}"
            + page_reference("howto/simulator")
        )

    def class_value(self, joint: str, attribute: str) -> str | None:
        """Value that the class of a joint, or one around that, gives an attribute."""
        one = self.joints[joint]
        around = (self.tags[i].attributes.get("childclass") for i in reversed(one.around))
        name = one.attributes.get("class") or next(filter(None, around), None)
        given = {
            tag.around[-1]: tag.attributes[attribute]
            for tag in self.tags
            if tag.name == "joint" and tag.path[-1:] == ("default",) and attribute in tag.attributes
        }
        for at in self._class_elements(name):
            if at in given:
                return given[at]
        return None

    def _class_elements(self, name: str | None) -> Iterator[int]:
        """Places of the elements of a class and those around it, and of the main one."""
        defaults = [i for i, tag in enumerate(self.tags) if tag.name == "default"]
        for i in defaults:
            if name is not None and self.tags[i].attributes.get("class") == name:
                yield i
                yield from (k for k in reversed(self.tags[i].around) if k in defaults)
        yield from (i for i in defaults if "default" not in self.tags[i].path)

    def value(self, joint: str, attribute: str) -> str | None:
        """Value of an attribute of a joint: its own, or that of its class."""
        own = self.joints[joint].attributes.get(attribute)
        return self.class_value(joint, attribute) if own is None else own

    def has_springdamper(self, joint: str) -> bool:
        """Whether `springdamper` overrides the damping of a joint."""
        numbers = (self.value(joint, "springdamper") or "0 0").split()
        return len(numbers) == 2 and all(float(one) > 0.0 for one in numbers)

    def separators(self, joint: str) -> list[str]:
        """What stands before the numbers of the copies of a joint, from the innermost."""
        around = [self.tags[i] for i in reversed(self.joints[joint].around)]
        return [one.attributes.get("sep", "") for one in around if one.name == "replicate"]

    @property
    def step_settings(self) -> Stepping:
        """How the model steps, as far as this file says."""
        given: dict[str, str] = {}
        for tag in self.tags:
            if tag.name == "option" and tag.path == ("mujoco",):
                given |= tag.attributes
        usual = Stepping()
        step = float(given.get("timestep", usual.timestep))
        return Stepping(step, given.get("integrator", usual.integrator))

    def joint_edit(
        self, joint: str, values: Mapping[str, Any], stiff: bool, stiffness: float | None
    ) -> Edit:
        """The joint with its values, and without what overrides them."""
        full = len((self.class_value(joint, "damping") or "").split()) > 1
        texts = mujoco_formats.joint_attributes(values, stiff, full)
        if self.has_springdamper(joint):
            texts["springdamper"] = "0 0"
            if stiffness is not None:
                texts["stiffness"] = files.number(stiffness)
        return files.attributes_set(self.raw, self.joints[joint].at, texts)

    def actuator_edits(self, found: Mapping[str, Mapping[str, Any]]) -> Iterator[Edit]:
        """Friction actuators set, put last among all, or taken out where there are none."""
        there = {tag.attributes.get("joint"): tag for tag in self.tags if _is_friction(tag)}
        taken = {tag.attributes.get("name") for tag in self.tags if "actuator" in tag.path}
        new = []
        for joint, values in found.items():
            bristles = mujoco_formats.has_bristles(values)
            old = there.get(joint)
            if old is not None and bristles:
                text = {"lugre": mujoco_formats.lugre_text(values)}
                yield files.attributes_set(self.raw, old.at, text)
            elif old is not None:
                yield files.remove_element(self.raw, old.at)
            elif bristles:
                name = f"{joint}_friction"
                name = "" if name in taken else name
                new.append(mujoco_formats.friction_actuator(joint, values, name))
        change = len(new) - sum(
            joint in there and not mujoco_formats.has_bristles(values)
            for joint, values in found.items()
        )
        if new:
            section = f"<actuator>{''.join(new)}</actuator>"
            yield files.child_appended(self.raw, self.tags[0].end, section)
        yield from self._key_edits(change)

    def _key_edits(self, change: int) -> Iterator[Edit]:
        """Keyframes with a state for each actuator that is new."""
        for tag in self.tags:
            if change > 0 and tag.name == "key" and "act" in tag.attributes:
                text = f"{tag.attributes['act']}{change * ' 0'}".strip()
                yield files.attributes_set(self.raw, tag.at, {"act": text})

    def option_edit(self, values: Mapping[str, str]) -> Edit:
        """Attributes of the option element, which is put first where there is none."""
        for tag in self.tags:
            if tag.name == "option" and tag.path == ("mujoco",):
                return files.attributes_set(self.raw, tag.at, values)
        words = " ".join(f'{n}="{v}"' for n, v in values.items())
        return files.child_added(self.raw, self.tags[0].at, f"<option {words}/>")


def _is_friction(tag: Element) -> bool:
    """Whether an element is an actuator that is the friction of a joint."""
    if tag.name != "dcmotor" or tag.path[-1:] != ("actuator",):
        return False
    return {"joint", "lugre"} <= tag.attributes.keys() and tag.attributes.get("input") == "none"


def kind_of(file: Mjcf, joint: str) -> str | None:
    """Kind of a joint as far as the file says; None where a file that it includes may say it."""
    included = any(tag.name == "include" for tag in file.tags)
    return file.value(joint, "type") or (None if included else "hinge")


__all__ = ["Element", "Mjcf", "kind_of"]
