"""Synthetic worlds with known truth, and a photographer in them: for the demo, tests, examples and experiments.

    room = environment(furnished_room())
    for shot in turn(8):
        frame = photograph(room, camera, shot.camera_from_world, exposure_ev=shot.exposure_ev, seed=shot.seed)
    truth = panorama(room, 4096)

    boards = charuco_box()
    photo = photograph(target_scene(boards, camera_position_mm=(25, -18, 12)), camera, camera_from_target)

    frame = photograph_on_arm(furnished_room(), camera, np.radians(30), arm=0.15)
    truth = true_mosaic(furnished_room(), 0.15, 1024)

    rotation, translation = pose_before_camera(board, 300.0, theta_deg=70.0)
    photo = photograph_target([board], camera, rotation, translation, blur_px=0.8, noise=0.004)
    true_pixels = camera.project(board.marks_on_target() @ rotation.T + translation)

A world is anything with `radiance(rays)`; the world's axes are x right, y down, z to the front.
"""

from fullsphere.mosaic.photographer import Scene, Shot, panorama, photograph, turn, window
from fullsphere.mosaic.world_panels import Panel, PanelScene
from fullsphere.mosaic.world_room import environment, furnished_room
from fullsphere.mosaic.world_sheets import SheetScene
from fullsphere.mosaic.world_target import charuco_box, photograph_target, pose_before_camera, target_scene
from fullsphere.mosaic.world_turn import TrueMosaic, photograph_on_arm, true_mosaic

__all__ = [
    "Panel",
    "PanelScene",
    "Scene",
    "SheetScene",
    "Shot",
    "TrueMosaic",
    "charuco_box",
    "environment",
    "furnished_room",
    "panorama",
    "photograph",
    "photograph_on_arm",
    "photograph_target",
    "pose_before_camera",
    "target_scene",
    "true_mosaic",
    "turn",
    "window",
]
