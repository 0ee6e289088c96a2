# SPDX-License-Identifier: Apache-2.0
"""HDF5 beyond single arrays: links, virtual data sets and NeXus."""
import os

import h5py
import numpy

from ramp import ramp

SHAPE = (4, 5, 6)


def check_links(tool):
    path = tool.path('links.h5')
    data = ramp(SHAPE, 'u1')
    with h5py.File(path, 'w') as file:
        file['data'] = data
        file['group/again'] = file['data']
        file['group/soft'] = h5py.SoftLink('/data')
        file['dangling'] = h5py.SoftLink('/nothing/here')
        file['outside'] = h5py.ExternalLink('other.h5', '/x/y')
        file['circle'] = h5py.SoftLink('/circle')
    tool.layout('HDF5', 'several names of one array: hard and soft links', path, data, name='/data')
    for name in ('/group/again', '/group/soft'):
        tool.equal(f'{path}:{name}', data, name=name)
    tool.layout_refused('HDF5', 'a soft link that leads nowhere', f'{path}:/dangling', 'it is a link to /nothing/here, which is not in the file')
    tool.refused(f'{path}:/circle', 'it is a link to /circle')
    tool.layout_refused('HDF5', 'an external link', f'{path}:/outside', 'it is a link to /x/y in the file other.h5; links to other files are not followed')


def check_sources(tool):
    """Virtual data sets, whose numbers are in other files."""
    data = ramp(SHAPE, 'u2')
    os.makedirs(tool.path('sources/parts'))
    path = tool.path('sources/virtual.h5')
    shapes = {'good': h5py.VirtualLayout(SHAPE, 'u2'), 'own': h5py.VirtualLayout(SHAPE, 'u2'), 'missing': h5py.VirtualLayout(SHAPE, 'u2'),
              'wrong': h5py.VirtualLayout(SHAPE, 'u2'), 'denied': h5py.VirtualLayout(SHAPE, 'u2'), 'moved': h5py.VirtualLayout(SHAPE, 'u2')}
    for k in range(SHAPE[0]):
        with h5py.File(tool.path(f'sources/parts/{k}.h5'), 'w') as file:
            file['slice'] = data[k]
        os.link(tool.path(f'sources/parts/{k}.h5'), tool.path(f'sources/{k}.h5'))
        shapes['good'][k] = h5py.VirtualSource(f'parts/{k}.h5', 'slice', SHAPE[1:])
        shapes['moved'][k] = h5py.VirtualSource(f'/no such folder/{k}.h5', 'slice', SHAPE[1:])
        shapes['missing'][k] = h5py.VirtualSource(f'parts/{k + 2}.h5', 'slice', SHAPE[1:])
        shapes['wrong'][k] = h5py.VirtualSource(f'parts/{k}.h5', 'other', SHAPE[1:])
    with h5py.File(tool.path('denied.h5'), 'w') as file:
        file['x'] = data
    shapes['denied'][...] = h5py.VirtualSource('../denied.h5', 'x', SHAPE)
    shapes['own'][...] = h5py.VirtualSource('.', 'data', SHAPE)
    with h5py.File(path, 'w') as file:
        file['data'] = data
        for name, layout in shapes.items():
            file.create_virtual_dataset(name, layout)
        file.create_dataset('raw', SHAPE, 'u2', external=[('numbers.raw', 0, h5py.h5f.UNLIMITED)])[...] = data
    for name in ('good', 'own', 'moved'):
        tool.layout('HDF5', 'virtual data sets of files beside it', f'{path}:/{name}', data)
    tool.layout_refused('HDF5', 'virtual data sets without their files', f'{path}:/missing', 'needs the file parts/4.h5, which is missing')
    tool.refused(f'{path}:/wrong', 'the array other of the file parts/0.h5, which cannot be opened')
    tool.refused(f'{path}:/denied', 'needs the file ../denied.h5, which is missing or lies outside')
    tool.layout_refused('HDF5', 'external storage', f'{path}:/raw', 'numbers.raw (external storage)')
    for name in ('numbers.raw', tool.path('numbers.raw')):
        if os.path.exists(name):
            os.remove(name)


def check_nexus(tool):
    data = ramp(SHAPE, 'f4')
    place = {'origin': [0, 10, 5], 'spacing': [0.5, 1, 2], 'direction': [1, 0, 0, 0, -1, 0, 0, 0, 1], 'unit': 'mm'}
    for name, is_default, old in (('default.nxs', True, False), ('one.nxs', False, False), ('old.nxs', False, True)):
        path = tool.path(name)
        with h5py.File(path, 'w') as file:
            group = file.create_group('entry/plot')
            group.attrs['NX_class'] = 'NXdata'
            group['counts'] = data
            file['entry/detector/mask'] = ramp(SHAPE, 'u1')
            group['counts_errors'] = data + 1
            for axis, values in (('height', [5, 7, 9, 11]), ('b', [10, 9, 8, 7, 6]), ('a', [0, 0.5, 1, 1.5, 2, 2.5])):
                group[axis] = numpy.array(values, 'f8')
                group[axis].attrs['units'] = 'mm'
            group['counts'].attrs['units'] = 'counts'
            group.attrs['signal'] = 'counts'
            if old:
                group['counts'].attrs['axes'] = 'height:b:a'
            else:
                group.attrs['axes'] = ['height', 'b', 'a']
            if is_default:
                file.attrs['default'] = 'entry'
                file['entry'].attrs['default'] = 'plot'
                other = file.create_group('entry/other')
                other['x'] = data
                other.attrs['signal'] = 'x'
        tool.layout('HDF5', 'NeXus: the signal of NXdata with its axes', path, data, name='/entry/plot/counts', value_unit='counts', **place)
        tool.equal(f'{path}?field=entry/detector/mask', ramp(SHAPE, 'u1'))


def letters(text):
    """Imaris writes attributes as lists of letters."""
    return numpy.array([c.encode() for c in str(text)], 'S1')


def write_imaris(path, levels, names=('DAPI', 'GFP'), extents=True):
    """`levels`: arrays of the dimensions t, c, z, y, x. The arrays of the file are filled up to whole chunks."""
    with h5py.File(path, 'w') as file:
        for level, data in enumerate(levels):
            for t, c in numpy.ndindex(data.shape[:2]):
                group = file.create_group(f'DataSet/ResolutionLevel {level}/TimePoint {t}/Channel {c}')
                padded = numpy.zeros([-(-n // 4) * 4 for n in data.shape[2:]], data.dtype)
                padded[tuple(slice(n) for n in data.shape[2:])] = data[t, c]
                group.create_dataset('Data', data=padded, chunks=(4, 4, 4), compression='gzip')
                group.create_dataset('Histogram', data=numpy.zeros(256, 'u8'))
                for axis, size in zip('ZYX', data.shape[2:]):
                    group.attrs['ImageSize' + axis] = letters(size)
        image = file.create_group('DataSetInfo/Image')
        if extents:
            for i, (low, high) in enumerate(((10, 13), (-5, 5), (0, 12))):
                image.attrs[f'ExtMin{i}'], image.attrs[f'ExtMax{i}'] = letters(low), letters(high)
        image.attrs['Unit'] = letters('um')
        for c, name in enumerate(names):
            file.create_group(f'DataSetInfo/Channel {c}').attrs['Name'] = letters(name)
        times = file.create_group('DataSetInfo/TimeInfo')
        for t in range(levels[0].shape[0]):
            times.attrs[f'TimePoint{t + 1}'] = letters(f'2012-02-{28 + t} 23:59:{30 + t}.500')


def check_imaris(tool):
    path = tool.path('cells.ims')
    levels = [ramp((2, 2, 6, 5, 6), 'u2'), ramp((2, 2, 3, 5, 3), 'u2') + 1]
    write_imaris(path, levels)
    layout = 'Imaris: channels, time points, levels of detail and extents'
    tool.layout('HDF5', layout, path, levels[0][0, 0], name='DAPI', other0='GFP', spacing=[0.5, 2, 2], origin=[10.25, -4, 1], unit='um', warnings=[])
    tool.layout('HDF5', layout, path + '?level=1&field=GFP', levels[1][1, 1], step=1, steps=2, times=[0, 86401], time_unit='s', spacing=[1, 2, 4],
                origin=[10.5, -4, 2], name='GFP')
    tool.equal(path + ':/DataSet/ResolutionLevel 1/TimePoint 0/Channel 0/Data', numpy.pad(levels[1][0, 0], ((0, 1), (0, 3), (0, 1))))
    tool.refused(path + '?level=2', 'there is no level 2', 'to 1')
    tool.refused(path + '?field=RFP', 'there is no field RFP')
    write_imaris(path, [levels[0][:1, :1]], names=(), extents=False)
    tool.equal(path, levels[0][0, 0], spacing=[1, 1, 1], unit='', warnings=['The image has no extents (ExtMin0 to ExtMax2); its spacing is unknown.'])


def check_openpmd(tool):
    """Meshes as the standard openPMD 1.1 describes them: (offset + (index + position) * spacing) * unit."""
    data = ramp(SHAPE, 'f4')
    mesh = {'gridSpacing': [3.0, 2.0, 1.0], 'gridGlobalOffset': [30.0, 20.0, 10.0], 'gridUnitSI': 1e-6, 'geometry': 'cartesian', 'dataOrder': 'C',
            'axisLabels': [b'z', b'y', b'x']}
    path = tool.path('openpmd.h5')
    with h5py.File(path, 'w') as file:
        file['data/1/fields/rho'] = data
        file['data/1/fields/rho'].attrs.update({**mesh, 'position': [0.5, 0.0, 0.25], 'unitSI': 2.5})
        file['data/1/fields/E/y'] = data
        file['data/1/fields/E'].attrs.update(mesh)
        for name, own in (('fortran', {'dataOrder': 'F', 'axisLabels': numpy.array(['x', 'y', 'z'], object)}), ('turned', {'axisLabels': [b'x', b'y', b'z']}),
                          ('fine', {'gridUnitSI': 1.0, 'gridSpacing': [3e-8, 2e-8, 1e-8], 'gridGlobalOffset': [0.0, 0.0, 0.0]}),
                          ('modes', {'geometry': 'thetaMode', 'axisLabels': [b'r', b'z'], 'gridSpacing': [3.0, 2.0]})):
            file['data/1/fields/' + name] = data
            file['data/1/fields/' + name].attrs.update({**mesh, **own})
    layout = 'openPMD: the place of a mesh'
    tool.layout('HDF5', layout, f'{path}:/data/1/fields/rho', data, spacing=[1, 2, 3], origin=[10.25, 20, 31.5], unit='um', warned='times 2.5 (unitSI)')
    tool.layout('HDF5', layout, f'{path}:/data/1/fields/E/y', data, spacing=[1, 2, 3], origin=[10, 20, 30], unit='um', warned='')
    tool.layout('HDF5', layout, f'{path}:/data/1/fields/fortran', data, spacing=[3, 2, 1], origin=[30, 20, 10], unit='um', warned='')
    tool.layout('HDF5', layout, f'{path}:/data/1/fields/turned', data.transpose(2, 1, 0), spacing=[3, 2, 1], origin=[30, 20, 10], unit='um', warned='')
    tool.equal(f'{path}:/data/1/fields/fine', data, spacing=[10, 20, 30], unit='nm', warned='')
    with h5py.File(path, 'r+') as file:
        file['flat'] = data[0]
        file['flat'].attrs.update({**mesh, 'axisLabels': [b'y', b'x'], 'gridSpacing': [2.0, 3.0], 'gridGlobalOffset': [0.0, 0.0]})
        file['wrong'] = data
        file['wrong'].attrs.update({**mesh, 'gridSpacing': [2.0, numpy.nan, 1.0]})
    tool.equal(f'{path}:/flat', data[:1], spacing=[3, 2, 3], unit='um', warned='')
    tool.equal(f'{path}:/wrong', data, spacing=[1, 1, 1], warned='has no valid gridSpacing: it is shown')
    tool.layout('HDF5', 'openPMD: a mesh that is not cartesian', f'{path}:/data/1/fields/modes', data, spacing=[1, 1, 1], warned='"thetaMode"',
                result='indices, and a warning')


def check_dream3d(tool):
    """Cells of a box; ORIGIN is a corner, the samples are the centres."""
    data = ramp((4, 5, 6, 3), 'f4')
    place = {'spacing': [0.5, 0.5, 2], 'origin': [1.25, 2.25, 4], 'warned': ''}
    numbers = {'DIMENSIONS': [6, 5, 4], 'SPACING': [0.5, 0.5, 2.0], 'ORIGIN': [1.0, 2.0, 3.0]}
    for name, group, is_new in (('old.dream3d', 'DataContainers/Image/CellData', False), ('new.dream3d', 'DataStructure/Image/Cell Data', True)):
        path = tool.path(name)
        with h5py.File(path, 'w') as file:
            file[group + '/Phases'], file[group + '/Euler'] = ramp((4, 5, 6, 1), 'i4'), data
            for key, values in numbers.items():
                if is_new:
                    file[os.path.dirname(group)].attrs['_' + key] = values
                else:
                    file[f'{os.path.dirname(group)}/_SIMPL_GEOMETRY/{key}'] = numpy.array(values, 'i8' if key == 'DIMENSIONS' else 'f4')
        tool.layout('HDF5', 'DREAM.3D: cells with their place', f'{path}?field=/{group}/Phases', ramp(SHAPE, 'i4'), **place)
        tool.layout('HDF5', 'DREAM.3D: cells with their place', f'{path}?field=/{group}/Euler 3', data[..., 2], **place)


def check(tool):
    check_openpmd(tool)
    check_dream3d(tool)
    check_imaris(tool)
    check_links(tool)
    check_sources(tool)
    check_nexus(tool)
