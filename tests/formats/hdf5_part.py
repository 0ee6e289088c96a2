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


def check(tool):
    check_links(tool)
    check_sources(tool)
    check_nexus(tool)
