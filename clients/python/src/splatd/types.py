# SPDX-License-Identifier: Apache-2.0
"""Types of the view, for type checkers and editors. generate_types.py writes this file from protocol/view.schema.json.

All members of a patch may be missing. None stands for the default of the volume. Vectors of the world are in the order
x, y, z, unlike the arrays of this package.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, TypedDict


class Camera(TypedDict, total=False):
    """The camera. Default: perspective, framing the whole volume."""

    #: Projection type.
    projection: Literal['perspective', 'orthographic'] | None
    #: Position of the eye, in world units.
    position: Sequence[float] | None
    #: The point at the centre of the image, in world units; must differ from position.
    target: Sequence[float] | None
    #: The direction that points up in the image; any length except zero, not parallel to the view direction.
    up: Sequence[float] | None
    #: Vertical field of view in degrees; perspective only.
    fov_y: float | None
    #: Height of the image in world units; orthographic only.
    height: float | None
    #: Distance from the eye to the near plane in world units; nearer voxels are not drawn; of points, Gaussians and
    #: shells close to the eye, nearer parts are not.
    near: float | None
    #: In a patch, instead of position and up: where the eye is around the target, in degrees. 0 is the front (the
    #: axis from which the default camera looks most), 90 the right side of an object whose front faces the eye.
    #: Azimuth, elevation, distance and roll that are missing keep their values.
    azimuth: float | None
    #: In a patch, like azimuth: the angle of the eye above the target, in degrees. 90 looks down on the top.
    elevation: float | None
    #: In a patch, like azimuth: the distance from the target to the eye, in world units.
    distance: float | None
    #: In a patch, like azimuth: turns the image clockwise around its centre, in degrees.
    roll: float | None


class _Point(TypedDict):
    #: Value in the unit of the data.
    value: float
    #: Red, green, blue: sRGB display values, composited without conversion.
    color: Sequence[float]
    #: Opacity over transfer_function.reference_length.
    opacity: float


class Point(_Point, total=False):
    """A point of the transfer function."""


class _GradientPoint(TypedDict):
    #: Gradient magnitude by central differences, in data units per world unit.
    magnitude: float
    #: Factor on the opacity.
    scale: float


class GradientPoint(_GradientPoint, total=False):
    """A point of the gradient factor."""


class TransferFunction(TypedDict, total=False):
    """Maps values to colour and opacity. Default: computed from the histogram of the volume."""

    #: Length in world units that points[].opacity refers to. Default: the smallest spacing.
    reference_length: float | None
    #: When values become colour and opacity: pre = per voxel, before splatting; post = per pixel of each sheet or
    #: slab, after the values are interpolated, which keeps edges sharp; auto = post for sheets and slabs if all
    #: fields of filter have their defaults, voxels are at least 0.35 px wide in the middle of the volume, and the
    #: backend interpolates sheets and has the memory for it, else pre. A patch that combines post with
    #: compositing.mode splat is refused.
    order: Literal['pre', 'post', 'auto'] | None
    #: Colour and opacity by value. Values rise strictly. Linear between points, constant outside.
    points: Sequence[Point] | None
    #: Factor on the opacity by gradient magnitude; it can hide flat regions. Magnitudes rise strictly. Linear
    #: between points, constant outside. Empty: no factor.
    gradient: Sequence[GradientPoint] | None


class Filter(TypedDict, total=False):
    """Reconstruction and antialiasing."""

    #: Variance of a footprint: ewa = kernel plus low-pass filter; reconstruction = kernel only; lowpass = low-pass
    #: filter only; adaptive = per block of voxels, the one of these three that its distance requires; swan = the
    #: kernel, scaled up uniformly until no axis is narrower than the low-pass filter; none = no kernel and no
    #: filter: a voxel is a flat rectangle of at least one pixel.
    mode: Literal['adaptive', 'ewa', 'reconstruction', 'lowpass', 'swan', 'none'] | None
    #: Shape of the reconstruction kernel: gaussian = a truncated Gaussian; cubic = Crawfis and Max's cubic, whose
    #: support ends 1.556 voxels from its centre.
    kernel: Literal['gaussian', 'cubic'] | None
    #: Standard deviation of the gaussian kernel in voxels, along each axis. Ignored with the cubic kernel, which
    #: has one shape, and with mode none.
    sigma: float | None
    #: Radius at which a gaussian footprint ends: Mahalanobis distance, in standard deviations. A footprint is
    #: scaled so that the part beyond its end is not lost; a larger radius comes nearer to the Gaussian without an
    #: end, of which exp(-cutoff²/2) lies beyond (1.1 % at 3, 0.03 % at 4). With compositing.mode sheet and order
    #: pre, the CPU may draw the Gaussian without an end for each radius from 3 on. Ignored with the cubic kernel
    #: and with mode none.
    cutoff: float | None
    #: Standard deviation of the low-pass filter in pixels. Ignored with the modes reconstruction and none.
    lowpass: float | None
    #: Mode adaptive: where c_min times the kernel's standard deviation on the screen exceeds that of the low-pass
    #: filter, only the kernel is used. At most c_max.
    c_min: float | None
    #: Mode adaptive: where c_max times the kernel's standard deviation on the screen is below that of the low-pass
    #: filter, only the filter is used; null = 2.5(1 + 2 tan²(fov_y/2)), 2.5 for an orthographic camera.
    c_max: float | None


class Window(TypedDict, total=False):
    """Window of a projection, in the unit of its number: the unit of the data; sum = that times the unit of length;
    sum with absorption = the absorbed share, 0 to 1."""

    #: The number that is shown half way from black to white; null = from the volume and the mode.
    center: float | None
    #: From black to white; null = from the volume and the mode.
    width: float | None


class Compositing(TypedDict, total=False):
    """How footprints combine to a pixel."""

    #: splat = one footprint at a time, front to back; sheet = footprints are summed per sheet, where a sheet is one
    #: slice of voxels along the axis that is closest to the view direction; slab = footprints are cut into slabs of
    #: equal thickness, bounded by equal distance from the eye (the CPU may bound them half way between slices
    #: instead), which avoids colour bleeding and popping. With order post and a filter whose fields all have their
    #: defaults, slab interpolates values on sheets half a slice apart, which is more exact than sheet and up to
    #: twice as slow; a filter that differs in any field gives splatted slabs. maximum, minimum, mean, sum =
    #: projections: one number of the interpolated values along the pixel's ray inside the volume and the clip;
    #: maximum and minimum never leave the range of the samples around; sum is the integral of max(value - zero, 0)
    #: along the ray, in the unit of the data times the unit of length. In grey it is opaque where the ray meets the
    #: volume. Samples that are not finite are left out. It uses neither filter, shading, attenuation nor
    #: transfer_function.order, and shows no slices.
    mode: Literal['splat', 'sheet', 'slab', 'maximum', 'minimum', 'mean', 'sum'] | None
    #: Opacity from optical depth τ: exponential = 1 − exp(−τ); linear = min(τ, 1).
    attenuation: Literal['exponential', 'linear'] | None
    #: Thickness of a slab in units of the smallest of the volume's three spacings (for a rectilinear grid: of their
    #: means). Points are divided in depth into parts of this thickness, in units of their size, at most 12. Thinner
    #: slabs are more exact and slower. Mode slab only; not used where slabs are interpolated.
    slab: float | None
    #: How the number of a projection becomes a colour: grey = the window, from black to white; transfer_function =
    #: the colour and the opacity of the transfer function at the number, not for sum.
    colors: Literal['grey', 'transfer_function'] | None
    #: Window of a projection, in the unit of its number: the unit of the data; sum = that times the unit of length;
    #: sum with absorption = the absorbed share, 0 to 1.
    window: Window | None
    #: Mode sum: the value that adds nothing, such as -1000 for air in Hounsfield units. Lower values count as this
    #: one; null = the smallest value of the volume.
    zero: float | None
    #: Mode sum, X-rays: attenuation per unit of the data above zero, in 1 / unit of length. The pixel's number is
    #: then the absorbed share 1 - exp(-absorption · integral). For Hounsfield units with zero = -1000 it is that of
    #: water over 1000: 2.0e-5 per mm at 65 keV. null = the integral itself.
    absorption: float | None


class _Light(TypedDict):
    #: Direction towards the light, any length except zero. In camera space, x points right, y up, z towards the
    #: viewer.
    direction: Sequence[float]


class Light(_Light, total=False):
    """A directional light."""

    #: Space of the direction; a light in camera space moves with the camera.
    space: Literal['camera', 'world']
    #: Red, green, blue factors.
    color: Sequence[float]


class Shading(TypedDict, total=False):
    """Shading by the gradient of the volume."""

    #: Shading model.
    mode: Literal['none', 'phong'] | None
    #: Ambient factor.
    ambient: float | None
    #: Diffuse factor.
    diffuse: float | None
    #: Specular factor.
    specular: float | None
    #: Blinn's exponent of the highlight.
    exponent: float | None
    #: How smooth normals are where sheets or slabs are classified per pixel: 0 = from the finest gradients, which
    #: show most detail and all noise; 1 = from smooth gradients over two samples; null = as smooth as the volume's
    #: noise asks for, and smoother where voxels are narrower than 1.2 px, unless quality.level_of_detail is off.
    smoothing: float | None
    #: Ambient occlusion: the strength at which matter nearby takes ambient and diffuse light away; 0 = nothing, 1 =
    #: all light of the directions that it covers. Needs mode phong, compositing.mode sheet and
    #: transfer_function.order post; with mode none it has no effect.
    occlusion: float | None
    #: Soft shadow: how much of the first light matter in its way takes away. 0 = nothing. Needs the same as
    #: occlusion, and a light.
    shadow: float | None
    #: How far ambient occlusion reaches, in diagonals of the volume: matter that far away occludes e times less
    #: than matter nearby. Small numbers darken narrow gaps alone. Used if occlusion is not 0.
    reach: float | None
    #: Directional lights.
    lights: Sequence[Light] | None


class _VolumeLayer(TypedDict):
    #: Always volume.
    type: Literal['volume']


class VolumeLayer(_VolumeLayer, total=False):
    """The whole volume, through transfer_function, filter and compositing."""

    #: False: the image is drawn as if there were no such layer.
    visible: bool


class _Surface(TypedDict):
    #: Always surface.
    type: Literal['surface']
    #: Value in the unit of the data. Outside the volume's range there is no surface.
    value: float


class Surface(_Surface, total=False):
    """The surface on which the interpolated volume has one value, by surface splatting. Lit as shading says."""

    #: False: the image is drawn as if there were no such layer.
    visible: bool
    #: Red, green, blue: sRGB display values.
    color: Sequence[float]
    #: Opacity of the surface.
    opacity: float
    #: How many times narrower kernels are along the gradient than across it: 1 = the kernels of the volume, inf =
    #: discs.
    flatness: float | Literal['inf']


class _Shell(TypedDict):
    #: Always shell.
    type: Literal['shell']


class Shell(_Shell, total=False):
    """The voxels at borders of opacity: those whose opacity is at least low and that have a neighbour whose opacity
    is below high. Voxels inside opaque matter are left out, which makes shells fast. Coloured by transfer_function,
    lit as shading says."""

    #: False: the image is drawn as if there were no such layer.
    visible: bool
    #: Opacity over transfer_function.reference_length. At most high.
    low: float
    #: Opacity over transfer_function.reference_length.
    high: float
    #: high = a Gaussian footprint of filter.sigma and filter.cutoff per voxel; fast = a flat square of 1.6 voxels.
    detail: Literal['high', 'fast']


class _Vectors(TypedDict):
    #: Always vectors.
    type: Literal['vectors']


class Vectors(_Vectors, total=False):
    """Streaks along the vectors of the samples or points, which move with the phase. Samples are coloured and made
    visible by transfer_function; a volume layer shows them a second time and hides the streaks where it is opaque.
    Needs a volume with vectors."""

    #: False: the image is drawn as if there were no such layer.
    visible: bool
    #: modulate = streaks are denser than what is between them; blend = streaks of one colour over the splats of the
    #: samples.
    style: Literal['modulate', 'blend']
    #: Of the streaks of style blend. Red, green, blue: sRGB display values.
    color: Sequence[float]
    #: How far streaks have moved along the vectors, in lengths of a streak. 1 looks like 0, so that a path from 0
    #: to 10 moves them by ten lengths.
    phase: float
    #: How many times longer splats are along the vector than across it.
    stretch: float
    #: Share of the samples that are drawn.
    density: float
    #: What gives the colours in place of the values, one number per sample or point: magnitude = the length of its
    #: vector; else the id of a loaded volume with as many samples, such as another field of the same file. Empty:
    #: the values. Opacities stay those of the values, and style blend has its own colour for streaks.
    color_by: str
    #: With color_by: the number that has the colour of the first point of transfer_function; null = the smallest
    #: one; for magnitude 0.
    color_low: float | None
    #: With color_by: the number that has the colour of the last point of transfer_function, above color_low; null =
    #: the largest one.
    color_high: float | None


class _Points(TypedDict):
    #: Always points.
    type: Literal['points']


class Points(_Points, total=False):
    """Points with a scalar each, drawn as Gaussians of the size that they have in the data. Coloured and made
    visible by transfer_function; each is composited on its own, in order of depth."""

    #: False: the image is drawn as if there were no such layer.
    visible: bool
    #: Id of the volume that has them. Empty: the volume of the view.
    id: str
    #: From the world of the data to that of the view: a 4 by 4 matrix, row by row. The last row is 0, 0, 0, 1; not
    #: singular.
    transform: Sequence[float]
    #: Factor on the size of points.
    size: float
    #: What gives the colours in place of the values, one number per sample or point: magnitude = the length of its
    #: vector; else the id of a loaded volume with as many samples, such as another field of the same file. Empty:
    #: the values. Opacities stay those of the values.
    color_by: str
    #: With color_by: the number that has the colour of the first point of transfer_function; null = the smallest
    #: one; for magnitude 0.
    color_low: float | None
    #: With color_by: the number that has the colour of the last point of transfer_function, above color_low; null =
    #: the largest one.
    color_high: float | None


class _Gaussians(TypedDict):
    #: Always gaussians.
    type: Literal['gaussians']


class Gaussians(_Gaussians, total=False):
    """The Gaussians of a trained scene (3D Gaussian splatting), with their own opacities and colours, in order of
    depth. Neither transfer_function nor shading changes them."""

    #: False: the image is drawn as if there were no such layer.
    visible: bool
    #: Id of the volume that has them. Empty: the volume of the view.
    id: str
    #: From the world of the data to that of the view: a 4 by 4 matrix, row by row. The last row is 0, 0, 0, 1; not
    #: singular.
    transform: Sequence[float]
    #: Factor on the opacities.
    opacity: float
    #: How the low-pass filter of 0.3 square pixels changes a Gaussian: inria = it becomes wider, and its opacity
    #: stays; normalised = it becomes wider and as much more transparent, so that small ones do not grow bright.
    convention: Literal['inria', 'normalised']


class _Geometry(TypedDict):
    #: Always geometry.
    type: Literal['geometry']


class Geometry(_Geometry, total=False):
    """The triangles of a mesh, lit as shading says on both sides."""

    #: False: the image is drawn as if there were no such layer.
    visible: bool
    #: Id of the volume that has them. Empty: the volume of the view.
    id: str
    #: From the world of the data to that of the view: a 4 by 4 matrix, row by row. The last row is 0, 0, 0, 1; not
    #: singular.
    transform: Sequence[float]
    #: Red, green, blue: sRGB display values. Without effect while colors is own and the mesh has colours.
    color: Sequence[float]
    #: Factor on the opacities of the mesh.
    opacity: float
    #: own = the colours of the vertices; layer = color.
    colors: Literal['own', 'layer']


class _Channel(TypedDict):
    #: Always channel.
    type: Literal['channel']
    #: Id of the volume that it shows, another one for each channel.
    id: str


class Channel(_Channel, total=False):
    """Another volume on the grid of the view's volume, such as another field of its file, with a transfer function
    of its own. Channels and the volume fill the same space: their extinctions add up, and their colours add up as
    light does, so red and green give yellow: the mixture has the hue of the sum by extinction and the mean
    brightness; in a projection, colours add up. Needs compositing.mode sheet or slab with order auto or post, or a
    projection; slab needs the default filter. Occlusion and shadow have no effect, and edits of type part are
    refused."""

    #: False: the image is drawn as if there were no such layer.
    visible: bool
    #: Red, green, blue: sRGB display values. Of a channel without points.
    color: Sequence[float]
    #: Its transfer function, as transfer_function.points; transfer_function.reference_length holds here, too.
    #: Empty: color, with an opacity that rises from 0 to 0.5 within the default window of its slices.
    points: Sequence[Point]


class _Plane(TypedDict):
    #: Normal that points to the visible side, in world space, any length except zero.
    normal: Sequence[float]
    #: Distance from the origin in world units, times the length of the normal.
    offset: float


class Plane(_Plane, total=False):
    """Keeps the points p with dot(normal, p) >= offset. The normal is not normalised, so offset scales with its
    length."""


class Clip(TypedDict, total=False):
    """Clipping: a point is visible if the box and all planes keep it. Default: no clipping. A kernel that crosses a
    cut keeps the share of it that lies on the visible side, so a cut is as smooth as the rest of the image. Where
    pixels are classified (transfer_function.order post), material that a plane or a face of the box cuts is lit by
    the normal of that plane; elsewhere by its own gradients."""

    #: Lower and upper corner of the visible box, as fractions of the volume's extent along its own axes: 0 is the
    #: outer face of the first voxel, 1 that of the last voxel. A face at 0 or 1 does not cut.
    box: Sequence[Sequence[float]] | None
    #: Clipping planes in world space; the side that the normal points to is visible.
    planes: Sequence[Plane] | None


class _PlaneEdit(TypedDict):
    #: Always plane.
    type: Literal['plane']
    #: Normal in world space, any length except zero.
    normal: Sequence[float]
    #: A point p stays if dot(normal, p) >= offset.
    offset: float


class PlaneEdit(_PlaneEdit, total=False):
    """A cut by a plane: the side that the normal points to stays."""


class _BoxEdit(TypedDict):
    #: Always box.
    type: Literal['box']
    #: Lower and upper corner, as fractions of the volume's extent, as in clip.box.
    box: Sequence[Sequence[float]]


class BoxEdit(_BoxEdit, total=False):
    """A cut by a box along the axes of the volume."""

    #: What stays.
    keep: Literal['outside', 'inside']


class _SphereEdit(TypedDict):
    #: Always sphere.
    type: Literal['sphere']
    #: Its centre, in world units.
    center: Sequence[float]
    #: Its radius in world units.
    radius: float


class SphereEdit(_SphereEdit, total=False):
    """A cut by a sphere."""

    #: What stays.
    keep: Literal['outside', 'inside']


class _PartEdit(TypedDict):
    #: Always part.
    type: Literal['part']
    #: A point of the part, or at most two samples beside it, in world units. If there is no such sample, nothing is
    #: removed.
    point: Sequence[float]
    #: Lowest and highest value of the part, in the unit of the data.
    range: Sequence[float]


class PartEdit(_PartEdit, total=False):
    """A connected part: the samples whose values lie in a range, as far as faces of such samples connect them with
    a point. The samples beside it that are not in the range go or stay with it."""

    #: outside = the part is removed; inside = only the part stays.
    keep: Literal['outside', 'inside']


class Quality(TypedDict, total=False):
    """Trade-off between quality and speed."""

    #: auto = voxels smaller than a pixel may be merged, and where post-classified samples are narrower than about
    #: two pixels, a low-pass filter of the pixels keeps edges smooth and turning views still; pixels that the
    #: silhouette of the volume or of its clipping crosses show a post-classified volume in a part of their area;
    #: off = nothing of that: every pixel shows the ray through its centre. Post-classified slabs always draw all
    #: voxels.
    level_of_detail: Literal['auto', 'off'] | None


class Planes(TypedDict, total=False):
    """Which of the orthogonal slices the image shows: i, j, k = the slice across the first, second, third axis of
    the volume's grid."""

    #: The slice across the first axis.
    i: bool | None
    #: The slice across the second axis.
    j: bool | None
    #: The slice across the third axis.
    k: bool | None


class Slices(TypedDict, total=False):
    """Slices of the volume through one position, for clients that show them beside the image (GET
    /api/v1/sessions/{id}/slice), and for the image itself. Shared by all participants. A change gives no new image
    unless the slices are drawn in it."""

    #: Which slices there are: orthogonal = three, along the axes of the volume; oblique = one, across the normal.
    mode: Literal['none', 'orthogonal', 'oblique'] | None
    #: Draw the slices in the image: opaque, from border to border whatever the clip is, with the volume in front of
    #: them. Of orthogonal slices those that `planes` names. Values that are not finite leave holes.
    in_3d: bool | None
    #: Which of the orthogonal slices the image shows: i, j, k = the slice across the first, second, third axis of
    #: the volume's grid.
    planes: Planes | None
    #: The point that all slices go through, in world units. Default: the centre of the volume.
    position: Sequence[float] | None
    #: Normal of the oblique slice in world space, any length except zero.
    normal: Sequence[float] | None
    #: The values that slices show from black to white, or from the first to the last colour of a map.
    window: Window | None
    #: How slices show values: grey and the colour maps over the window; transfer_function = in the colours of its
    #: points, whatever their opacity and the window.
    colors: Literal['grey', 'transfer_function', 'viridis', 'inferno', 'cividis', 'turbo', 'blue-red'] | None


class Time(TypedDict, total=False):
    """Which part of a time series the view shows."""

    #: The time step, from 0, below `steps.count` of the volume. The daemon loads it when a view asks for it. Other
    #: volumes that layers name in id or color_by show the same step, or their last one if they have fewer; beside a
    #: volume with one step they show the step that they were opened with. Default: the step that the volume was
    #: opened with.
    step: int | None


class ViewPatch(TypedDict, total=False):
    """Everything that a frame depends on. A view is a merge patch (RFC 7396) of the default view of its volume (GET
    /api/v1/volumes/{id}/view): a field that is missing or null takes the default, an array replaces the whole
    array, and an unknown field is refused. Rules that a schema cannot express: camera.position differs from
    camera.target; camera.up is not parallel to the line between them; directions and normals are not so short that
    they count as zero; values rise strictly along lists of points; c_min is at most c_max; layers have at most one
    volume, one shell and one layer of vectors, and low is at most high, color_low below color_high; boxes and
    ranges of edits begin at or below their end; the lower corner of clip.box lies at or below the upper corner;
    transfer_function.order "post" excludes compositing.mode "splat" in the resulting view; compositing.colors
    "transfer_function" excludes compositing.mode "sum"; slices.mode "oblique" with slices.in_3d allows only 7 clip
    planes; numbers are finite. Lengths are in world units, the unit of the volume's spacing."""

    #: Id of the volume, at most 127 bytes of UTF-8. A patch that changes the volume starts from the default view of
    #: the new volume and keeps size and background.
    volume: str | None
    #: Width and height of the image in pixels.
    size: Sequence[int] | None
    #: Colour behind the volume: red, green, blue, alpha as sRGB display values, not premultiplied.
    background: Sequence[float] | None
    #: The camera. Default: perspective, framing the whole volume.
    camera: Camera | None
    #: Maps values to colour and opacity. Default: computed from the histogram of the volume.
    transfer_function: TransferFunction | None
    #: Reconstruction and antialiasing.
    filter: Filter | None
    #: How footprints combine to a pixel.
    compositing: Compositing | None
    #: Shading by the gradient of the volume.
    shading: Shading | None
    #: What is drawn into the image, in any order: each layer is in front of what is farther from the eye. At most
    #: one volume, one shell and one layer of vectors. Clipping applies to all layers.
    layers: Sequence[VolumeLayer | Surface | Shell | Vectors | Points | Gaussians | Geometry | Channel] | None
    #: Clipping: a point is visible if the box and all planes keep it. Default: no clipping. A kernel that crosses a
    #: cut keeps the share of it that lies on the visible side, so a cut is as smooth as the rest of the image.
    #: Where pixels are classified (transfer_function.order post), material that a plane or a face of the box cuts
    #: is lit by the normal of that plane; elsewhere by its own gradients.
    clip: Clip | None
    #: Removes matter from what all layers show, one edit after the other; the volume itself never changes. Removed
    #: samples take a value that is transparent; where the view shows all values (no value of the transfer function
    #: is transparent, a projection, slices in the image), they become holes. Cuts are as sharp as one sample; clip
    #: cuts more sharply and costs less.
    edits: Sequence[PlaneEdit | BoxEdit | SphereEdit | PartEdit] | None
    #: Trade-off between quality and speed.
    quality: Quality | None
    #: Slices of the volume through one position, for clients that show them beside the image (GET
    #: /api/v1/sessions/{id}/slice), and for the image itself. Shared by all participants. A change gives no new
    #: image unless the slices are drawn in it.
    slices: Slices | None
    #: Which part of a time series the view shows.
    time: Time | None
