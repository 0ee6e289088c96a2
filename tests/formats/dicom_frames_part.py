# SPDX-License-Identifier: Apache-2.0
"""DICOM files with several frames, written with pydicom: each voxel has its value and its place in the world.

The module dicom_files writes the files; what is expected follows from the position, direction and slope of each frame.
"""
import numpy
from pydicom import dcmread
from pydicom.sequence import Sequence

import dicom_files as files
from dicom_files import Frame, item


def check_world(tool, source, frames, step=0, **wanted):
    """Each pixel of `frames` has its value at its place in the world, and there are no other planes."""
    info, samples = tool.dump(source, step)
    tool.checks += 1
    if info is None:
        return
    direction = numpy.reshape(info['direction'], (3, 3))
    to_index = numpy.linalg.inv(direction * info['spacing'])
    planes = set()
    for number, frame in enumerate(frames):
        rows, columns = numpy.indices(frame.values.shape)
        at = (numpy.array(frame.position, float)[:, None] + numpy.array(frame.along[0], float)[:, None] * columns.ravel() * frame.spacing[0]
              + numpy.array(frame.along[1], float)[:, None] * rows.ravel() * frame.spacing[1])
        index = to_index @ (at - numpy.array(info['origin'])[:, None])
        if 'coordinates2' in info:
            index[2] = numpy.interp(index[2] * info['spacing'][2], info['coordinates2'], numpy.arange(len(info['coordinates2'])))
        near = numpy.rint(index).astype(int)
        if not numpy.allclose(index, near, atol=1e-3) or (near < 0).any() or (near.max(axis=1) >= samples.shape[::-1]).any():
            tool.fail(source, f'frame {number} at {frame.position} is not where the grid has samples: index {index[:, 0]}')
            return
        planes.update(near[2])
        got = samples[near[2], near[1], near[0]].reshape(frame.values.shape)
        expected = frame.values * frame.slope + frame.intercept
        if not numpy.allclose(got, expected, rtol=1e-6, atol=1e-9):
            tool.fail(source, f'frame {number} at {frame.position}: {got.ravel()[:4]}, expected {numpy.ravel(expected)[:4]}')
            return
    if len(planes) != samples.shape[0]:
        tool.fail(source, f'{samples.shape[0]} planes, {len(planes)} expected')
    compare(tool, source, info, wanted)


def compare(tool, source, info, wanted):
    for key, value in wanted.items():
        got = info.get(key)
        is_same = numpy.allclose(got, value, rtol=1e-5, atol=1e-6) if isinstance(value, list) and got is not None else got == value
        if not is_same:
            tool.fail(source, f'{key} is {got}, expected {value}')


def others(tool, source, *names):
    info, _ = tool.dump(source)
    tool.checks += 1
    got = [info[f'other{i}'] for i in range(16) if f'other{i}' in info] if info else None
    if got != list(names):
        tool.fail(source, f'the other fields are {got}, expected {list(names)}')


def check_places(tool):
    """Enhanced CT: shuffled, against the normal, sagittal, oblique, with slopes, gaps, two stacks, in each byte order."""
    stack = files.stack(6)
    for name, order in (('shuffled', (3, 0, 5, 1, 4, 2)), ('falling', (5, 4, 3, 2, 1, 0)), ('rising', range(6))):
        path = files.enhanced(tool.path(f'{name}.dcm'), [stack[i] for i in order])
        check_world(tool, path, stack, value_unit='', spacing=[0.7, 0.5, 2.0], unit='mm', anatomy='LPS')
    check_world(tool, tool.path('falling.dcm'), stack, origin=[5, 6, 10], direction=[1, 0, 0, 0, 1, 0, 0, 0, -1])
    check_world(tool, tool.path('shuffled.dcm'), stack, origin=[5, 6, 0], direction=[1, 0, 0, 0, 1, 0, 0, 0, 1])
    sagittal = files.stack(5, along=((0, 1, 0), (0, 0, -1)), step=(3, 0, 0), slopes=(1, 2, 0.5, 3, 7))
    check_world(tool, files.enhanced(tool.path('sagittal.dcm'), sagittal), sagittal, origin=[5, 6, 0], direction=[0, 0, 1, 1, 0, 0, 0, -1, 0], type='float32')
    c, s = numpy.cos(0.3), numpy.sin(0.3)
    oblique = files.stack(4, along=((c, s, 0), (-s * c, c * c, s)), step=(0.4, -0.2, 1.5))
    check_world(tool, files.enhanced(tool.path('oblique.dcm'), oblique), oblique)
    gap = stack[:2] + stack[3:]
    check_world(tool, files.enhanced(tool.path('gap.dcm'), gap), gap)
    for syntax in files.SYNTAXES:
        check_world(tool, files.enhanced(tool.path('syntax.dcm'), stack, syntax=syntax), stack)
    other = files.stack(3, along=((0, 1, 0), (0, 0, -1)), step=(3, 0, 0))
    check_world(tool, files.enhanced(tool.path('stacks.dcm'), other + stack), stack)
    named = files.stack(4, first=(5, 6, 100), stack_id='2')
    check_world(tool, files.enhanced(tool.path('named.dcm'), named + stack), stack)
    check_world(tool, files.enhanced(tool.path('one.dcm'), stack[:1]), stack[:1], spacing=[0.7, 0.5, 2.0])
    shared = files.stack(3)
    check_world(tool, files.enhanced(tool.path('scaled.dcm'), shared, scaled='shared'), [f.scaled(2, -100) for f in shared])


def check_times(tool):
    stack = [[Frame(f.values + 1000 * t, **f.place()) for f in files.stack(4)] for t in range(3)]

    def write(name, order, **groups):
        frames = []
        for t, z in order:
            frame = stack[t][z]
            frame.groups = {key: make(t, z) for key, make in groups.items()}
            frames.append(frame)
        return files.enhanced(tool.path(name), frames, modality='MR')

    by_time = [(t, z) for t in range(3) for z in range(4)]
    by_place = [(t, z) for z in reversed(range(4)) for t in (1, 2, 0)]
    for order in (by_time, by_place):
        path = write('index.dcm', order, FrameContentSequence=lambda t, z: item(TemporalPositionIndex=t + 1))
        for t in range(3):
            check_world(tool, path, stack[t], step=t, steps=3)
        path = write('trigger.dcm', order, CardiacSynchronizationSequence=lambda t, z: item(NominalCardiacTriggerDelayTime=40.0 * t + 5))
        check_world(tool, path, stack[2], step=2, steps=3, times=[0.005, 0.045, 0.085], time_unit='s')
        path = write('clock.dcm', order, FrameContentSequence=lambda t, z: item(FrameReferenceDateTime=f'2024022823595{7 + t}.5' if t < 3 else ''))
        check_world(tool, path, stack[1], step=1, steps=3, times=[0.0, 1.0, 2.0], time_unit='s')
        path = write('offset.dcm', order, TemporalPositionSequence=lambda t, z: item(TemporalPositionTimeOffset=2.5 * t))
        check_world(tool, path, stack[1], step=1, steps=3, times=[0.0, 2.5, 5.0], time_unit='s')
    path = write('stopped.dcm', by_time[:-2], FrameContentSequence=lambda t, z: item(TemporalPositionIndex=t + 1))
    check_world(tool, path, stack[1], step=1, steps=2)


def check_contrasts(tool):
    """Echoes, diffusion and parts of complex images are fields, many directions are steps."""
    stack = [[Frame(f.values + 1000 * t, **f.place()) for f in files.stack(3)] for t in range(2)]

    def write(name, **groups):
        frames = []
        for z in range(3):
            for t in (1, 0):
                stack[t][z].groups = {key: make(t) for key, make in groups.items()}
                frames.append(stack[t][z])
        return files.enhanced(tool.path(name), frames, modality='MR')

    path = write('echoes.dcm', MREchoSequence=lambda t: item(EffectiveEchoTime=2.3 + 2.3 * t))
    check_world(tool, path, stack[0], name='echo 2.3 ms', steps=1)
    check_world(tool, path + '?field=echo 4.6 ms', stack[1], name='echo 4.6 ms', steps=1)
    others(tool, path, 'echo 4.6 ms')
    path = write('diffusion.dcm', MRDiffusionSequence=lambda t: item(DiffusionBValue=1000.0 * t))
    check_world(tool, path + '?field=b 1000 s/mm²', stack[1], steps=1)
    path = write('complex.dcm', MRImageFrameTypeSequence=lambda t: item(FrameType=['ORIGINAL', 'PRIMARY', 'VOLUME', 'NONE'],
                                                                        ComplexImageComponent=('MAGNITUDE', 'PHASE')[t]))
    check_world(tool, path + '?field=VOLUME MAGNITUDE', stack[0], steps=1)
    check_world(tool, path + '?field=VOLUME PHASE', stack[1], steps=1)
    directions = []
    for n in range(20):
        for frame in files.stack(2):
            angle = 0.1 * n
            frame = Frame(frame.values + 500 * n, **frame.place())
            frame.groups = {'MRDiffusionSequence': item(DiffusionBValue=1000.0, DiffusionGradientDirectionSequence=[
                item(DiffusionGradientOrientation=[float(numpy.cos(angle)), float(numpy.sin(angle)), 0.0])])}
            directions.append(frame)
    path = files.enhanced(tool.path('directions.dcm'), directions, modality='MR')
    check_world(tool, path, directions[14:16], step=7, steps=20)


def check_nuclear(tool):
    stack = files.stack(5, step=(0, 0, -2), first=(1, 2, 10))
    path = files.nuclear(tool.path('nm.dcm'), stack, between=-2)
    check_world(tool, path, stack, origin=[1, 2, 10], direction=[1, 0, 0, 0, 1, 0, 0, 0, -1])
    stack = files.stack(3, first=(1, 2, 10))
    gated = [[Frame(f.values + 1000 * t, **f.place()) for f in stack] for t in range(2)]
    path = files.nuclear(tool.path('gated.dcm'), gated[0] + gated[1], between=2, SliceVector=[1, 2, 3] * 2, TimeSlotVector=[1] * 3 + [2] * 3, slot_ms=50)
    check_world(tool, path, gated[1], step=1, steps=2, times=[0.0, 0.05], time_unit='s')
    path = files.nuclear(tool.path('energy.dcm'), gated[0] + gated[1], between=2, SliceVector=[1, 2, 3] * 2, EnergyWindowVector=[1] * 3 + [2] * 3)
    check_world(tool, path + '?field=energy window 2', gated[1], steps=1)
    dynamic = [Frame(stack[0].values + 1000 * t, **stack[0].place()) for t in range(4)]
    path = files.nuclear(tool.path('dynamic.dcm'), dynamic, PhaseVector=[1, 1, 2, 2], TimeSliceVector=[1, 2, 1, 2], phases_ms=(1000, 5000))
    check_world(tool, path, dynamic[3:], step=3, steps=4, times=[0.0, 1.0, 2.0, 7.0], time_unit='s')
    # Numbers of vectors have 16 bits: they tell times apart whatever their size.
    large = files.nuclear(tool.path('large.dcm'), dynamic, RotationVector=[2, 1, 2, 1], AngularViewVector=[1, 4097, 4097, 1])
    for step, frame in enumerate((3, 1, 0, 2)):
        check_world(tool, large, dynamic[frame:frame + 1], step=step, steps=4)
    turns = files.nuclear(tool.path('turns.dcm'), dynamic, RotationVector=[1, 1, 1, 1], AngularViewVector=[4, 3, 2, 1])
    check_world(tool, turns, dynamic[2:3], step=1, steps=4)


def check_plain(tool):
    """Spacing and places at the top level: secondary captures, films, doses."""
    stack = files.stack(4)
    values = numpy.stack([f.values for f in stack])
    for tag in ('PixelSpacing', 'NominalScannedPixelSpacing', 'ImagerPixelSpacing'):
        path = files.capture(tool.path('sc.dcm'), stack, **{tag: [0.5, 0.3], 'SliceThickness': 0.4})
        tool.equal(path, values, spacing=[0.3, 0.5, 0.4], unit='mm', steps=1)
    path = files.capture(tool.path('film.dcm'), stack, FrameIncrementPointer=0x00181063, FrameTime=40.0)
    for t in range(4):
        tool.equal(path, values[t:t + 1], step=t, steps=4, times=[0.0, 0.04, 0.08, 0.12], time_unit='s')
    tool.equal(files.capture(tool.path('xa.dcm'), stack, Modality='XA', CineRate=25), values[3:], step=3, steps=4)
    uneven = files.capture(tool.path('xa2.dcm'), stack, Modality='XA', FrameIncrementPointer=0x00181065, FrameTimeVector=[0, 10, 10, 20])
    tool.equal(uneven, values[3:], step=3, steps=4, times=[0, 0.01, 0.02, 0.04], time_unit='s')
    for offsets in ((0, 2.5, 5, 7.5), (3, 5.5, 8, 10.5), (0, -2.5, -5, -7.5), (0, 2.5, 7.5, 10)):
        shift = offsets[0]
        dose = [Frame(f.values, position=(1, 2, 3 + n - shift), slope=0.001) for f, n in zip(stack, offsets)]
        path = files.dose(tool.path('dose.dcm'), dose, offsets)
        check_world(tool, path, dose, value_unit='Gy', type='float64')


def check_segments(tool):
    """The pixels of a frame need not fill whole bytes, and frames without any are left out."""
    rng = numpy.random.default_rng(1)
    places = [Frame(None, position=(0, 0, 2.5 * z)).place() for z in range(6)]
    left = {z: rng.integers(0, 2, (7, 9)) for z in (0, 1, 3)}
    right = {z: (rng.integers(0, 2, (7, 9)) if z != 1 else 1 - left[1]) for z in (1, 4, 5)}
    listed = [(1, z, left[z]) for z in left] + [(3, z, right[z]) for z in right]
    path = files.segmentation(tool.path('seg.dcm'), [(n, Frame(mask, **places[z])) for n, z, mask in listed], {1: 'Left lung', 3: 'Right lung'})
    labels = numpy.zeros((6, 7, 9), 'u1')
    for number, z, mask in listed:
        labels[z][mask > 0] = number
    tool.equal(path, labels, name='labels', type='uint8', spacing=[0.7, 0.5, 2.5], steps=1)
    others(tool, path, 'Left lung', 'Right lung')
    for name, masks in (('Left lung', left), ('Right lung', right)):
        tool.equal(f'{path}?field={name}', numpy.stack([masks.get(z, numpy.zeros((7, 9))) for z in range(6)]), name=name)
    listed = [(n, Frame(rng.integers(0, 201, (7, 9)), **places[z])) for n in (1, 2) for z in range(3)]
    path = files.segmentation(tool.path('share.dcm'), listed, {1: 'bone', 2: 'water'}, most=200)
    for n, name in ((0, 'bone'), (1, 'water')):
        tool.equal(f'{path}?field={name}', numpy.float32(numpy.stack([f.values / 200 for _, f in listed[3 * n:3 * n + 3]])), name=name)


def check_maps(tool):
    """Parametric maps: float and double, with a mapping to the real world and its unit."""
    for dtype in ('f4', 'f8'):
        stack = files.stack(3, dtype=dtype)
        for frame in stack:
            frame.values = frame.values / 8 - 3
        path = files.parametric(tool.path('map.dcm'), stack, dtype, slope=1.0, intercept=0.0)
        kind, before = {'f4': 'float32', 'f8': 'float64'}[dtype], tool.failed
        check_world(tool, path, stack, value_unit='mm2/s', type=kind)
        if tool.failed == before:
            tool.table.add_type('DICOM', kind, kind)
    stack = files.stack(3)
    path = files.parametric(tool.path('map.dcm'), stack, 'u2', slope=0.25, intercept=-2.0)
    check_world(tool, path, [f.scaled(0.25, -2) for f in stack], value_unit='mm2/s')
    for name, syntax in (('map big', files.SYNTAXES[2]), ('map implicit', files.SYNTAXES[1])):
        stack = files.stack(3, dtype='f4')
        check_world(tool, files.parametric(tool.path(f'{name}.dcm'), stack, 'f4', slope=2.0, intercept=1.0, syntax=syntax), [f.scaled(2, 1) for f in stack])


    path = files.with_table(tool.path('table.dcm'), stack, [n * n for n in range(240)])
    tool.equal(path, [frame.values for frame in stack], value_unit='')
    info, _ = tool.dump(path)
    if info and not any('real world' in text and 'lookup table' in text for text in info['warnings']):
        tool.fail(path, f'expected a warning of the lookup table, got: {info["warnings"]}')


def check_types(tool):
    """Each type of sample in either byte order; bits that are not used are noise."""
    rng = numpy.random.default_rng(2)
    layouts = ((8, 5, 4), (16, 12, 13), (32, 20, 19), (8, 8, 7), (16, 16, 15), (16, 12, 11), (16, 10, 15), (32, 32, 31))
    for syntax in files.SYNTAXES:
        is_first = syntax == files.SYNTAXES[0]
        for allocated, stored, high in layouts if is_first else layouts[1:3]:
            for signed in (0, 1) if is_first else (1,):
                if syntax in files.PACKED:
                    allocated, stored, high = 16, 12, 11
                low = -2 ** (stored - 1) if signed else 0
                values = rng.integers(low, low + 2 ** stored, (3, 5, 7))
                values[0, 0, :2] = low, low + 2 ** stored - 1
                path = files.typed(tool.path('type.dcm'), values, allocated, stored, high, signed, syntax)
                if stored == allocated:
                    tool.typed('DICOM', ('uint', 'int')[signed] + str(stored), path, values)
                else:
                    tool.layout('DICOM', f'{stored} of {allocated} bits, the highest is {high}; the others are noise', path, values)
        bits = rng.integers(0, 2, (3, 5, 7))
        tool.typed('DICOM', '1 bit', files.typed(tool.path('bits.dcm'), bits, 1, 1, 0, 0, syntax), bits, type='uint8')


def check_colors(tool):
    rng = numpy.random.default_rng(3)
    colors = rng.integers(0, 256, (4, 6, 8, 3), 'u1')
    luma = numpy.array([[1, 0, 1.402], [1, -0.114 * 1.772 / 0.587, -0.299 * 1.402 / 0.587], [1, 1.772, 0]])
    for planar in (0, 1):
        path = files.colored(tool.path('rgb.dcm'), colors, 'RGB', planar)
        for channel, name in enumerate(('red', 'green', 'blue')):
            tool.typed('DICOM', 'RGB', f'{path}?field={name}', colors[2:3, ..., channel], step=2, steps=4, name=name)
        path = files.colored(tool.path('ybr.dcm'), colors, 'YBR_FULL', planar)
        rgb = numpy.clip(numpy.floor((colors - numpy.array([0.0, 128, 128])) @ luma.T + 0.5), 0, 255)
        for channel, name in enumerate(('red', 'green', 'blue')):
            tool.layout('DICOM', f'YBR_FULL, PlanarConfiguration {planar}', f'{path}?field={name}', rgb[1:2, ..., channel], step=1, result='RGB')
    halved = colors.copy()
    halved[:, :, 1::2, 1:] = halved[:, :, ::2, 1:]
    rgb = numpy.clip(numpy.floor((halved - numpy.array([0.0, 128, 128])) @ luma.T + 0.5), 0, 255)
    for channel, name in enumerate(('red', 'green', 'blue')):
        tool.layout('DICOM', 'YBR_FULL_422', files.halved(tool.path('422.dcm'), halved) + f'?field={name}', rgb[3:, ..., channel], step=3, result='RGB')
    for dtype, first in (('u1', 0), ('u2', 100)):
        indices = rng.integers(0, 200, (4, 6, 8)).astype(dtype)
        table = rng.integers(0, 65536, (150, 3))
        path = files.palette(tool.path('palette.dcm'), indices, table, first)
        rows = table[numpy.clip(indices.astype(int) - first, 0, 149)] >> 8
        for channel, name in enumerate(('red', 'green', 'blue')):
            tool.layout('DICOM', f'a palette, {dtype[1]} bytes per index', f'{path}?field={name}', rows[1:2, ..., channel], step=1, result='RGB',
                        warned='rounded to 8 bits')


    # Pairs of pixels do not cross rows, and other colours are not taken for known ones.
    path = files.halved(tool.path('odd.dcm'), halved)
    tool.refused(files.changed(path, Columns=7), 'YBR_FULL_422 with 7 columns', 'must be even')
    for name in ('YBR_PARTIAL_422', 'HSV'):
        tool.refused(files.colored(tool.path('other.dcm'), colors, name, 0), 'PhotometricInterpretation', 'supported are RGB')


def check_region(tool):
    """An ultrasound region without a scale of both axes says nothing about the pixels."""
    stack = files.stack(2)
    for x, y, spacing, unit in ((0.02, 0.05, [0.2, 0.5, 1], 'mm'), (0.02, None, [1, 1.5, 1], ''), (0.0, 0.05, [1, 1.5, 1], '')):
        region = item(PhysicalUnitsXDirection=3, PhysicalUnitsYDirection=3, PhysicalDeltaX=x)
        if y is not None:
            region.PhysicalDeltaY = y
        path = files.capture(tool.path('us.dcm'), stack, Modality='US', SequenceOfUltrasoundRegions=[region], PixelAspectRatio=[3, 2])
        tool.equal(path, stack[0].values[None], spacing=spacing, unit=unit)


def check_names(tool):
    """Texts in Latin 1 become UTF-8, so that a field with such a name can be chosen; longer UTF-8 characters stay."""
    for charset, name in (('ISO_IR 100', 'Größe der Läsion'), ('ISO_IR 192', 'Läsion 𝛼')):
        frames = [(n, Frame(numpy.full((4, 4), n, 'u1') - 1)) for n in (1, 2)]
        path = files.segmentation(tool.path('names.dcm'), frames, {1: 'other', 2: 'XX'})
        data = dcmread(path)
        data.SpecificCharacterSet = charset
        data.SegmentSequence[1].SegmentLabel = name
        data.save_as(path)
        tool.equal(f'{path}?field={name}', numpy.ones((1, 4, 4)), name=name)


def check_dimensions(tool):
    """Four unknown dimensions, whose indices are more than one number can hold exactly."""
    frames = files.stack(1) * 3
    frames = [Frame(frames[0].values + 100 * n, **frames[0].place()) for n in range(3)]
    pointers = [item(DimensionIndexPointer=tag) for tag in (0x00181314, 0x00180081, 0x00180091, 0x00180084)]
    for frame, index in zip(frames, ((65535, 65535, 65535, 2), (65535, 65535, 65535, 1), (65535, 65535, 65535, 3))):
        frame.groups = {'FrameContentSequence': item(DimensionIndexValues=list(index))}
    path = files.changed(files.enhanced(tool.path('dimensions.dcm'), frames, modality='MR'), DimensionIndexSequence=Sequence(pointers))
    info, samples = tool.dump(path)
    tool.checks += 1
    if info and (info['steps'] != 1 or not numpy.array_equal(samples[0], frames[1].values) or 'other1' not in info):
        tool.fail(path, f'expected three fields, of which frame 2 is the first: {info}')


def check_refused(tool):
    stack = files.stack(4)
    path = files.enhanced(tool.path('cut.dcm'), stack)
    with open(path, 'r+b') as file:
        file.truncate(file.seek(0, 2) - 50)
    tool.refused(path, 'cut.dcm', 'cut off')
    path = files.enhanced(tool.path('twice.dcm'), stack[:3] + [stack[1]])
    tool.refused(path, 'frame 2 of twice.dcm and frame 4 of twice.dcm show the same place')
    for number, members in enumerate(({'DimensionOrganizationType': 'TILED_FULL', 'TotalPixelMatrixColumns': 40, 'TotalPixelMatrixRows': 8},
                                      {'DimensionOrganizationType': 'TILED_SPARSE'}, {'SOPClassUID': '1.2.840.10008.5.1.4.1.1.77.1.6'})):
        path = files.changed(files.enhanced(tool.path(f'tiles{number}.dcm'), stack), **members)
        tool.refused(path, '4 tiles of a whole-slide image', 'export')
    path = files.changed(files.enhanced(tool.path('focus.dcm'), stack), SOPClassUID='1.2.840.10008.5.1.4.1.1.77.1.6', TotalPixelMatrixColumns=10,
                         TotalPixelMatrixRows=8)
    tool.refused(path, '4 frames of one tile', 'planes of focus', 'TIFF stack')
    path = files.changed(files.enhanced(tool.path('whole.dcm'), stack[:1]), TotalPixelMatrixColumns=10, TotalPixelMatrixRows=8)
    tool.equal(path, stack[0].values[None])


def check(tool):
    for part in (check_places, check_times, check_contrasts, check_nuclear, check_plain, check_segments, check_maps, check_types, check_colors,
                 check_region, check_names, check_dimensions, check_refused):
        part(tool)
