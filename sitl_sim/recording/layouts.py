"""How viewers show a swarm's log: a layout for Foxglove, a blueprint for Rerun."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

_APPLICATION = "swarm-companion"
_FLAT = 0.4  # height of a drone's body in Rerun by its width


def foxglove_layout(names: Sequence[str]) -> dict[str, Any]:
    """Return a layout: the swarm in 3-D, the first drone's camera, speeds, and all events."""
    first = names[0]
    shown = ["/truth/scene", *(f"/{n}/scene" for n in names), *(f"/truth/{n}/pose" for n in names)]
    speeds = [
        {"value": f"/{n}/tick.speed", "enabled": True, "label": n, "timestampMethod": "receiveTime"}
        for n in names
    ]
    panels: dict[str, Any] = {
        "3D!swarm": {
            "followTf": "world",
            "followMode": "follow-none",
            "topics": {topic: {"visible": True} for topic in shown},
            "layers": {"grid": {"layerId": "foxglove.Grid", "size": 60, "divisions": 60}},
        },
        "Image!camera": {
            "imageMode": {
                "imageTopic": f"/truth/{first}/camera",
                "annotations": {f"/{first}/annotations": {"visible": True}},
                "synchronize": True,
            },
            "foxglovePanelTitle": f"camera of {first}",
        },
        "Plot!speeds": {
            "paths": speeds,
            "showLegend": True,
            "isSynced": True,
            "foxglovePanelTitle": "speed asked for [m/s]",
        },
        "RosOut!events": {"topicToRender": f"/{first}/events", "searchTerms": []},
    }
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {
            "direction": "row",
            "splitPercentage": 62,
            "first": {
                "direction": "column",
                "splitPercentage": 70,
                "first": "3D!swarm",
                "second": "Plot!speeds",
            },
            "second": {
                "direction": "column",
                "splitPercentage": 60,
                "first": "Image!camera",
                "second": "RosOut!events",
            },
        },
    }


def write_foxglove_layout(names: Sequence[str], path: Path) -> Path:
    """Write the layout for Foxglove (*Layouts → Import from file*); return its path."""
    path.write_text(json.dumps(foxglove_layout(names), indent=1), encoding="utf-8")
    return path


def write_rerun(
    swarm_log: Path, radii: Mapping[str, float], path: Path, believing: Collection[str]
) -> Path:
    """Write a swarm's log with its blueprint as a recording of Rerun; needs rerun-sdk.

    radii: of each drone by its name [m]. believing: drones with companions. Rerun draws no poses by
    themselves: so each drone is a flat body where it truly was, and a wire frame, a fifth larger,
    where it believed itself.
    """
    import rerun

    names = list(radii)

    with rerun.RecordingStream(_APPLICATION) as recording:
        recording.save(str(path))
        recording.send_blueprint(rerun_blueprint(names))
        recording.log_file_from_path(str(swarm_log))
        for name, radius in radii.items():
            fill = rerun.components.FillMode
            for topic, size, mode, labels in (
                (f"/truth/{name}/pose", radius, fill.Solid, [name]),
                (f"/{name}/pose", 1.2 * radius, fill.MajorWireframe, None),
            ):
                if not topic.startswith("/truth") and name not in believing:
                    continue
                body = rerun.Ellipsoids3D(
                    half_sizes=[[size, size, _FLAT * size]], fill_mode=mode, labels=labels
                )
                recording.log(topic, body, static=True)
        recording.flush()
    return path


def rerun_blueprint(names: Sequence[str]) -> Any:
    """Return the views: the swarm in 3-D, the first drone's camera, and all events."""
    from rerun import blueprint as views

    first = names[0]
    swarm = views.Spatial3DView(
        name="swarm",
        origin="/",
        contents=[
            "+ /truth/**",
            *(f"- /truth/{n}/camera" for n in names),
            *(f"+ /{n}/{topic}" for n in names for topic in ("pose", "tf")),
        ],
        spatial_information=views.SpatialInformation(target_frame="world"),
    )
    camera = views.Spatial2DView(name=f"camera of {first}", origin=f"/truth/{first}/camera")
    events = views.TextLogView(name="events", contents=[f"+ /{n}/events" for n in names])
    side = views.Vertical(camera, events, row_shares=[3, 2])
    both = views.Horizontal(swarm, side, column_shares=[5, 3])
    return views.Blueprint(both, collapse_panels=True)
