"""How projections are written; in a file of its own, so that a help page loads no library."""

PROJECTIONS_HELP = """\
A projection is one of these; SIZE is WIDTHxHEIGHT in pixels, angles are in degrees, [parts] may be left out:

  camera.json                                      a lens from a file, calibrated or written by hand
  equirectangular:WIDTH                            the whole sphere, half as high as wide
  equirectangular:SIZE[:lon=-90..90][:lat=-20..25] a window of it
  cylindrical:SIZE[:hfov=360][:lat=-40..40]        uprights stay straight
  mercator:SIZE[:hfov=360][:lat=-60..60]           angles are kept
  perspective:SIZE:hfov=90                         an ordinary view, less than 180 degrees; straight lines stay straight
  stereographic:SIZE:hfov=150                      a wide view that keeps angles, less than 360
  littleplanet:SIZE[:hfov=300]                     the same, looking down; 300 degrees across the shorter side
  equidistant:SIZE:fov=183, equisolid:.., orthographic:.., thoby:..
                                                   fisheye lenses, to 360, 360, 180 and 252 degrees
  cube:SIDE[:layout=3x2]                           six faces of SIDE pixels: 3x2, strip, cross or vertical-cross
  360x360:WIDTH                                    the 360 x 360 mosaic, as high as wide; or 360x360:SIZE

A lens is given one field of view: hfov across the width, vfov across the height or dfov across the diagonal of the
picture, which it fills to the corners; or fov, but not for a perspective view, that of a circular image as wide as
the shorter side, outside of which it sees nothing.
Where WIDTH stands alone for SIZE, the pixels are square: lens pictures are square, windows need lat=.
Each of them, camera.json too, may be turned by :yaw=30 (to the right) :pitch=10 (up) :roll=5 (clockwise).
"""
"""How projections are written."""
