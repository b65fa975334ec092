"""The types of OPC 40100-1, Machine Vision, release 1.0, that Prooflight uses, built in the address space.

Names of nodes, the namespace and the numbers of its types are the specification's. Parts that Prooflight does
not fill are left out: recipes, configurations, step models, conditions, and methods, because the press is not
controlled by this server.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from asyncua import ua
from asyncua.common.structures104 import new_struct, new_struct_field
from asyncua.ua.object_ids import ObjectIds

if TYPE_CHECKING:
    from asyncua.common.node import Node
    from asyncua.server.server import Server

NAMESPACE: Final = "http://opcfoundation.org/UA/MachineVision"
VISION_STATES: Final = ("Preoperational", "Halted", "Error", "Operational")
"""States of ``VisionStateMachineType``; their numbers are their positions, from 1."""
AUTOMATIC_STATES: Final = ("Initialized", "Ready", "SingleExecution", "ContinuousExecution")
"""States of ``VisionAutomaticModeStateMachineType``, within Operational."""
VISION_TRANSITIONS: Final = (
    "PreoperationalToHaltedAuto",
    "PreoperationalToErrorAuto",
    "PreoperationalToOperationalAuto",
    "HaltedToPreoperationalAuto",
    "ErrorToPreoperationalAuto",
    "ErrorToHaltedAuto",
    "ErrorToOperationalAuto",
    "OperationalToPreoperationalAuto",
    "OperationalToHaltedAuto",
    "OperationalToErrorAuto",
)
AUTOMATIC_TRANSITIONS: Final = (
    "InitializedToReadyAuto",
    "ReadyToInitializedAuto",
    "ReadyToSingleExecutionAuto",
    "ReadyToContinuousExecutionAuto",
    "SingleExecutionToReadyAuto",
    "ContinuousExecutionToReadyAuto",
)
RESULT_FIELDS: Final = (
    ("ResultId", "ResultIdDataType"),
    ("IsPartial", ua.VariantType.Boolean),
    ("IsSimulated", ua.VariantType.Boolean),
    ("ResultState", ua.VariantType.Int32),
    ("MeasId", "MeasIdDataType"),
    ("PartId", "PartIdDataType"),
    ("JobId", "JobIdDataType"),
    ("CreationTime", ua.VariantType.DateTime),
    ("ProcessingTimes", "ProcessingTimesDataType"),
    ("ResultContent", ua.VariantType.String),
)
"""Fields of ``ResultReadyEventType`` and of a result variable."""
COMPLETED, ABORTED = 1, 3
"""Values of ``ResultStateDataType``: undefined, completed, processing, aborted, failed, from 0."""
_NUMBERS: Final = {
    "VisionSystemType": 1003,
    "ResultManagementType": 1007,
    "VisionEventType": 1015,
    "ResultFolderType": 1016,
    "VisionStateMachineType": 1017,
    "StateChangedEventType": 1018,
    "VisionAutomaticModeStateMachineType": 1021,
    "ResultReadyEventType": 1024,
    "VisionInformationEventType": 1038,
    "ResultType": 2002,
    "PartIdDataType": 3004,
    "ProcessingTimesDataType": 3005,
    "MeasIdDataType": 3015,
    "JobIdDataType": 3016,
    "ResultIdDataType": 3021,
}
"""Numbers that identify the specification's own nodes."""
_TEXT, _WORDS, _TIME, _DURATION = (
    ua.VariantType.String,
    ua.VariantType.LocalizedText,
    ua.VariantType.DateTime,
    ua.VariantType.Double,
)
_STRUCTURES: Final = {
    "ResultIdDataType": (("Id", _TEXT),),
    "MeasIdDataType": (("Id", _TEXT), ("Description", _WORDS)),
    "PartIdDataType": (("Id", _TEXT), ("Description", _WORDS)),
    "JobIdDataType": (("Id", _TEXT), ("Description", _WORDS)),
    "ProcessingTimesDataType": (
        ("StartTime", _TIME),
        ("EndTime", _TIME),
        ("AcquisitionDuration", _DURATION),
        ("ProcessingDuration", _DURATION),
    ),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class VisionTypes:
    """Types that were built."""

    index: int
    nodes: dict[str, Node]
    """Types by name; states and transitions as TYPE.NAME."""
    structures: dict[str, Any]


async def build(server: Server) -> VisionTypes:
    """Build the types in a server's address space."""
    index = await server.register_namespace(NAMESPACE)
    nodes: dict[str, Node] = {}

    def at(name: str) -> tuple[ua.NodeId, ua.QualifiedName]:
        return _id(_NUMBERS[name], index), ua.QualifiedName(name, index)

    for name, parts in _STRUCTURES.items():
        fields = [new_struct_field(part, kind) for part, kind in parts]
        nodes[name], _ = await new_struct(server, *at(name), fields)
    await server.load_data_type_definitions()
    # A class that another server of this process has had made is not made again.
    structures = {name: getattr(ua, name) for name in _STRUCTURES}

    async def object_type(name: str, base: ua.NodeId | int) -> Node:
        nodes[name] = await server.get_node(base).add_object_type(*at(name))
        return nodes[name]

    for name, base, states, transitions in (
        (
            "VisionAutomaticModeStateMachineType",
            ObjectIds.FiniteStateMachineType,
            AUTOMATIC_STATES,
            AUTOMATIC_TRANSITIONS,
        ),
        ("VisionStateMachineType", ObjectIds.FiniteStateMachineType, VISION_STATES, VISION_TRANSITIONS),
    ):
        machine = await object_type(name, _id(base))
        nodes |= await _states(machine, name, index, states, transitions)
    await _component(
        nodes["VisionStateMachineType"],
        "AutomaticModeStateMachine",
        nodes["VisionAutomaticModeStateMachineType"],
        index,
    )

    result = await server.get_node(ObjectIds.BaseDataVariableType).add_variable_type(
        *at("ResultType"), _id(ObjectIds.BaseDataType)
    )
    nodes["ResultType"] = result
    await _fields(result, nodes, index)
    folder = await object_type("ResultFolderType", _id(ObjectIds.FolderType))
    management = await object_type("ResultManagementType", _id(ObjectIds.BaseObjectType))
    await _component(management, "Results", folder, index)
    system = await object_type("VisionSystemType", _id(ObjectIds.BaseObjectType))
    await _component(system, "VisionStateMachine", nodes["VisionStateMachineType"], index)
    await _component(system, "ResultManagement", management, index)

    vision_event = await object_type("VisionEventType", _id(ObjectIds.TransitionEventType))
    await vision_event.add_property(index, "CausePath", "", ua.VariantType.String)
    await object_type("StateChangedEventType", vision_event.nodeid)
    information = await object_type("VisionInformationEventType", _id(ObjectIds.BaseEventType))
    await information.add_property(index, "CausePath", "", ua.VariantType.String)
    ready = await object_type("ResultReadyEventType", _id(ObjectIds.TransitionEventType))
    await _fields(ready, nodes, index)
    return VisionTypes(index=index, nodes=nodes, structures=structures)


async def _states(
    machine: Node, name: str, index: int, states: tuple[str, ...], transitions: tuple[str, ...]
) -> dict[str, Node]:
    nodes: dict[str, Node] = {}
    for number, state in enumerate(states, start=1):
        kind = ObjectIds.InitialStateType if number == 1 else ObjectIds.StateType
        node = await machine.add_object(index, state, objecttype=_id(kind))
        await (await node.get_child("0:StateNumber")).write_value(number, ua.VariantType.UInt32)
        nodes[f"{name}.{state}"] = node
    for number, transition in enumerate(transitions, start=1):
        node = await machine.add_object(index, transition, objecttype=_id(ObjectIds.TransitionType))
        await (await node.get_child("0:TransitionNumber")).write_value(number, ua.VariantType.UInt32)
        start, end = transition.removesuffix("Auto").split("To")
        await node.add_reference(nodes[f"{name}.{start}"], ObjectIds.FromState, bidirectional=False)
        await node.add_reference(nodes[f"{name}.{end}"], ObjectIds.ToState, bidirectional=False)
        nodes[f"{name}.{transition}"] = node
    return nodes


async def _component(owner: Node, name: str, kind: Node, index: int) -> None:
    await _mandatory(await owner.add_object(index, name, objecttype=kind.nodeid))


async def _mandatory(node: Node) -> None:
    """Make the node and all below it mandatory, so that they are created with each instance of the owner."""
    await node.set_modelling_rule(True)
    for child in await node.get_children():
        await _mandatory(child)


async def _fields(owner: Node, nodes: dict[str, Node], index: int) -> None:
    """Add the properties of ``RESULT_FIELDS``."""
    for name, kind in RESULT_FIELDS:
        if isinstance(kind, ua.VariantType):
            value = [""] if name == "ResultContent" else ua.get_default_value(kind)
            node = await owner.add_property(index, name, value, kind)
        else:
            node = await owner.add_property(
                index,
                name,
                None,
                ua.VariantType.ExtensionObject,
                datatype=nodes[kind].nodeid,
            )
        await node.set_modelling_rule(True)


def _id(number: int, index: int = 0) -> ua.NodeId:
    return ua.NodeId(ua.Int32(number), ua.Int16(index))
