# SPDX-License-Identifier: Apache-2.0
"""Types of formats whose files are short enough to write them here, byte by byte, or that SimpleITK writes: VTK, Amira, .vol, PVM, PNG, JPEG."""
import base64
import os
import struct
import zlib

import numpy
import SimpleITK

from types_part import samples, widened

SHAPE = (3, 4, 16)  # z, y, x
INTEGERS = ('int8', 'uint8', 'int16', 'uint16', 'int32', 'uint32', 'int64', 'uint64')
COLOURS = ('red', 'green', 'blue', 'alpha')


def write(path, *parts):
    with open(path, 'wb') as file:
        for part in parts:
            file.write(part.encode() if isinstance(part, str) else part)
    return path


def spelled(values):
    """The numbers as text, so that nothing of them is lost."""
    return ' '.join(str(int(v)) if values.dtype.kind in 'iub' else repr(float(v)) for v in values.ravel())


# VTK

LEGACY = {'1 bit': 'bit', 'int8': 'char', 'uint8': 'unsigned_char', 'int16': 'short', 'uint16': 'unsigned_short', 'int32': 'int', 'uint32': 'unsigned_int',
          'int64': 'vtktypeint64', 'uint64': 'vtktypeuint64', 'float32': 'float', 'float64': 'double'}


def legacy(path, kind, payload, form, attribute=None):
    x, y, z = SHAPE[::-1]
    attribute = attribute or f'SCALARS values {kind} 1\nLOOKUP_TABLE default'
    return write(path, f'# vtk DataFile Version 3.0\ntitle\n{form}\nDATASET STRUCTURED_POINTS\nDIMENSIONS {x} {y} {z}\nORIGIN 1 2 3\nSPACING 1 2 3\n'
                 f'POINT_DATA {x * y * z}\n{attribute}\n', payload, '\n')


def check_vtk_legacy(tool):
    path = tool.path('type.vtk')
    for kind, name in LEGACY.items():
        values = samples(kind, SHAPE)
        wanted = {'spacing': [1, 2, 3], 'origin': [1, 2, 3]}
        packed = numpy.packbits(values).tobytes() if kind == '1 bit' else values.astype(values.dtype.newbyteorder('>')).tobytes()
        tool.typed('VTK legacy', kind, legacy(path, name, packed, 'BINARY'), widened(values), 'STRUCTURED_POINTS, BINARY', **wanted)
        if values.dtype.kind == 'f':  # VTK writes neither NaN nor infinite numbers as text
            values.ravel()[2:4] = 1, 2
        tool.typed('VTK legacy', kind, legacy(path, name, spelled(values), 'ASCII'), widened(values), 'STRUCTURED_POINTS, ASCII', **wanted)
    for kind, count in (('RGB', 3), ('RGBA', 4)):
        colours = samples('uint8', (*SHAPE, count))
        legacy(path, '', colours.tobytes(), 'BINARY', f'COLOR_SCALARS colours {count}')
        check_colours(tool, 'VTK legacy', kind, path, colours, 'colours ')
    for kind in INTEGERS + ('float32', 'float64'):
        SimpleITK.WriteImage(SimpleITK.GetImageFromArray(samples(kind, SHAPE)), tool.path('itk.vtk'))
        tool.typed('VTK legacy', kind, tool.path('itk.vtk'), widened(samples(kind, SHAPE)), 'as SimpleITK writes it')


def check_vtk_components(tool):
    """SimpleITK writes any number of components as SCALARS."""
    data = numpy.stack([samples('uint16', SHAPE) // (i + 1) for i in range(6)], -1)
    for count in (2, 5, 6):
        SimpleITK.WriteImage(SimpleITK.GetImageFromArray(numpy.ascontiguousarray(data[..., :count]), isVector=True), tool.path('many.vtk'))
        for i in (0, count - 1):
            tool.equal(f'{tool.path("many.vtk")}?field=scalars component {i + 1}', data[..., i])


def check_colours(tool, form, kind, path, colours, before=''):
    for i, name in enumerate(COLOURS[:colours.shape[-1]]):
        tool.typed(form, kind, f'{path}?field={before}{name}', colours[..., i], name=before + name)


def blocks(raw, pack, word):
    """A header of the numbers and sizes of blocks, then the blocks, as VTK packs them."""
    size = 100
    parts = [raw[i:i + size] for i in range(0, len(raw), size)]
    packed = [pack(part) for part in parts]
    last = len(raw) % size
    return struct.pack(f'{word[0]}{3 + len(parts)}{word[1]}', len(parts), size, last, *map(len, packed)), b''.join(packed)


def vti(path, kind, values, order, form, is_wide=False, is_packed=False, count=1):
    """An image; `form`: ascii, binary (base64), appended (base64) or raw."""
    word = order + ('Q' if is_wide else 'I')
    raw = values.astype(values.dtype.newbyteorder(order)).tobytes()
    head, body = blocks(raw, zlib.compress, word) if is_packed else (struct.pack(word, len(raw)), raw)
    coded = base64.b64encode(head) + base64.b64encode(body) if is_packed else base64.b64encode(head + body)
    packer, offset = ' compressor="vtkZLibDataCompressor"', ' offset="0"'
    extent = ' '.join(f'0 {n - 1}' for n in SHAPE[::-1])
    text = {'ascii': spelled(values).encode(), 'binary': coded}.get(form, b'')
    tail = {'appended': b'<AppendedData encoding="base64">_' + coded + b'</AppendedData>',
            'raw': b'<AppendedData encoding="raw">_' + head + body + b'</AppendedData>'}.get(form, b'')
    return write(path, f'<VTKFile type="ImageData" version="1.0" byte_order="{"Little" if order == "<" else "Big"}Endian" '
                 f'header_type="UInt{64 if is_wide else 32}"{packer if is_packed else ""}>\n'
                 f'<ImageData WholeExtent="{extent}" Origin="1 2 3" Spacing="1 2 3"><Piece Extent="{extent}"><PointData Scalars="values">\n'
                 f'<DataArray type="{kind}" Name="values" NumberOfComponents="{count}" format="{"appended" if tail else form}"{offset if tail else ""}>',
                 text, '</DataArray></PointData></Piece></ImageData>\n', tail, '</VTKFile>\n')


def check_vtk_xml(tool):
    path = tool.path('type.vti')
    for kind in INTEGERS + ('float32', 'float64'):
        name = kind.replace('uint', 'UInt').replace('int', 'Int').replace('float', 'Float')
        forms = (('binary', False, False, '<'), ('raw', False, True, '>'), ('ascii', False, False, '<'))
        if kind == 'uint16':
            forms += (('binary', True, True, '>'), ('appended', True, False, '<'), ('raw', True, False, '>'))
        for form, is_wide, is_packed, order in forms:
            values = samples(kind, SHAPE)
            if form == 'ascii' and values.dtype.kind == 'f':
                values.ravel()[2:4] = 1, 2
            vti(path, name, values, order, form, is_wide, is_packed)
            layout = f'{form}{", zlib" if is_packed else ""}, lengths of {64 if is_wide else 32} bits' if form != 'ascii' else 'ascii'
            tool.typed('VTK XML', kind, path, widened(values), 'ImageData, ' + layout, spacing=[1, 2, 3], origin=[1, 2, 3])
    for kind, count in (('RGB', 3), ('RGBA', 4)):
        colours = samples('uint8', (*SHAPE, count))
        check_colours(tool, 'VTK XML', kind, vti(path, 'UInt8', colours, '<', 'raw', count=count), colours, 'values ')


# Amira, .vol, PVM

def check_amira(tool):
    path = tool.path('type.am')
    kinds = {'uint8': 'byte', 'int16': 'short', 'uint16': 'ushort', 'int32': 'int', 'uint32': 'uint', 'float32': 'float', 'float64': 'double'}
    for kind, name in kinds.items():
        values = samples(kind, SHAPE)
        rest = (f'define Lattice {" ".join(map(str, SHAPE[::-1]))}\nParameters {{ BoundingBox 1 16 2 5 3 5, CoordType "uniform" }}\n'
                f'Lattice {{ {name} Data }} @1')
        wanted = {'spacing': [1, 1, 1], 'origin': [1, 2, 3]}
        for form, order in (('BINARY-LITTLE-ENDIAN 2.1', '<'), ('BINARY 2.0', '>')):
            raw = values.astype(values.dtype.newbyteorder(order)).tobytes()
            write(path, f'# AmiraMesh {form}\n{rest}\n@1\n', raw, '\n')
            tool.typed('Amira', kind, path, widened(values), form, **wanted)
            if order == '<' and kind != 'uint16':
                continue
            packed = zlib.compress(raw)
            write(path, f'# AmiraMesh {form}\n{rest}(HxZip,{len(packed)})\n@1\n', packed, '\n')
            tool.typed('Amira', kind, path, widened(values), 'HxZip', **wanted)
        if values.dtype.kind == 'f':
            values.ravel()[2:4] = 1, 2
        write(path, f'# AmiraMesh 3D ASCII 2.0\n{rest}\n@1\n{spelled(values)}\n')
        tool.typed('Amira', kind, path, widened(values), '3D ASCII 2.0', **wanted)


def check_vol(tool):
    path = tool.path('type.vol')
    x, y, z = SHAPE[::-1]
    for kind, number in (('float32', 1), ('float16', 2), ('uint8', 3)):
        values = samples(kind, SHAPE)
        write(path, struct.pack('<3sB5i6f', b'VOL', 3, number, x, y, z, 1, 0, 0, 0, 15, 6, 4), values.tobytes())
        tool.typed('.vol', kind, path, widened(values), 'Mitsuba', spacing=[1, 2, 2])
    for kind, count in (('RGB', 3), ('RGBA', 4)):
        colours = samples('uint8', (*SHAPE, count))
        write(path, struct.pack('<3sB5i6f', b'VOL', 3, 3, x, y, z, count, 0, 0, 0, 15, 6, 4), colours.tobytes())
        check_colours(tool, '.vol', kind, path, colours)
    for kind in ('uint8', 'uint16', 'uint32', 'uint64'):
        values = samples(kind, SHAPE)
        for version, raw in ((2, values.tobytes()), (3, zlib.compress(values.tobytes()))):
            write(path, f'X: {x}\nY: {y}\nZ: {z}\nVoxel-Size: {values.itemsize}\nVoxel-Endian: 0\nVersion: {version}\n.\n', raw)
            tool.typed('.vol', kind, path, widened(values), f'DGtal, version {version}')
    for kind, name in (('uint8', 'unsigned integer'), ('uint16', 'unsigned integer'), ('int8', 'signed integer'), ('int16', 'signed integer'), ('float32', 'float')):
        values = samples(kind, SHAPE)
        write(tool.path('scan.raw'), values.tobytes())
        path = write(tool.path('scan.vgi'), f'{{volume1}}\n[file1]\nSize = {x} {y} {z}\nDatatype = {name}\n'
                     f'BitsPerElement = {8 * values.itemsize}\nName = scan.raw\n')
        tool.typed('.vol', kind, path, widened(values), 'VGStudio (.vgi)')


def check_pvm(tool):
    for kind in ('uint8', 'uint16'):
        values = samples(kind, SHAPE)
        raw = values.astype(values.dtype.newbyteorder('>')).tobytes()
        x, y, z = SHAPE[::-1]
        for head, spacing in (('PVM\n', [1, 1, 1]), ('PVM2\n', [1, 2, 3]), ('PVM3\n', [1, 2, 3])):
            more = '' if head == 'PVM\n' else '1 2 3\n'
            path = write(tool.path('type.pvm'), f'{head}{x} {y} {z}\n{more}{values.itemsize}\n', raw)
            tool.typed('PVM', kind, path, values, head[:-1], spacing=spacing)


# Images

def png(path, bits, color, rows, more=b''):
    """A PNG of packed rows of `color` type 0 (grey) or 3 (a palette), one number per pixel. OpenImageIO takes long to load, so there are few images."""
    def chunk(name, data):
        return struct.pack('>I', len(data)) + name + data + struct.pack('>I', zlib.crc32(name + data))
    width = len(rows[0]) * 8 // bits
    return write(path, b'\x89PNG\r\n\x1a\n', chunk(b'IHDR', struct.pack('>IIBBBBB', width, len(rows), bits, color, 0, 0, 0)), more and chunk(b'PLTE', more),
                 chunk(b'IDAT', zlib.compress(b''.join(b'\0' + row for row in rows))), chunk(b'IEND', b''))


def check_png(tool):
    path = tool.path('image.png')
    for kind in ('uint8', 'uint16'):
        values = samples(kind, (4, 16))
        SimpleITK.WriteImage(SimpleITK.GetImageFromArray(values), path)
        tool.typed('PNG', kind, path, values[None], 'as SimpleITK writes it')
    for kind, dtype in (('RGB', 'uint8'), ('RGB', 'uint16'), ('RGBA', 'uint8')):
        colours = samples(dtype, (1, 4, 16, len(kind)))
        SimpleITK.WriteImage(SimpleITK.GetImageFromArray(colours[0], isVector=True), path)
        tool.typed('PNG', kind, f'{path}?field={COLOURS[len(kind) - 1]}', colours[..., -1])
    ramp = numpy.arange(64).reshape(4, 16)
    for bits in (1, 4):
        values = ramp % 2 ** bits
        rows = [numpy.packbits(((row[:, None] >> numpy.arange(bits)[::-1]) & 1).astype('u1')).tobytes() for row in values]
        expected = values[None] * (255 // (2 ** bits - 1))
        path = png(tool.path('bits.png'), bits, 0, rows)
        if bits == 1:
            tool.typed('PNG', '1 bit', path, expected)
        else:
            tool.layout('PNG', f'{bits} bits', path, expected, result='scaled to 255')
    table = (numpy.arange(64 * 3) * 7 % 256).astype('u1').reshape(64, 3)
    path = png(tool.path('palette.png'), 8, 3, [row.astype('u1').tobytes() for row in ramp], table.tobytes())
    tool.layout('PNG', 'a palette', f'{path}?field=blue', table[ramp][None, ..., 2], result='read as RGB', name='blue')


def check_jpeg(tool):
    """The numbers are SimpleITK's where the colour is even: decoders differ in how they enlarge the planes of colour."""
    path = tool.path('image.jpg')
    smooth = numpy.add.outer(numpy.arange(24) * 5, numpy.arange(32) * 2).astype('u1')
    SimpleITK.WriteImage(SimpleITK.GetImageFromArray(smooth), path, True, 95)
    tool.typed('JPEG', 'uint8', path, SimpleITK.GetArrayFromImage(SimpleITK.ReadImage(path))[None])
    colours = numpy.stack([smooth, smooth + 20, smooth + 60], -1)
    SimpleITK.WriteImage(SimpleITK.GetImageFromArray(colours, isVector=True), path, True, 95)
    tool.typed('JPEG', 'RGB', path + '?field=green', SimpleITK.GetArrayFromImage(SimpleITK.ReadImage(path))[None, ..., 1])


# Elements

def far_files(tool, points, triangles):
    """The points with coordinates as float64 or text, as points and as a mesh."""
    count, faces = len(points), len(triangles)
    text = [' '.join(f'{x:.4f}' for x in p) for p in points]
    ply = 'ply\nformat {} 1.0\nelement vertex %d\nproperty double x\nproperty double y\nproperty double z\n' % count
    poly = f'# vtk DataFile Version 3.0\ntitle\nBINARY\nDATASET POLYDATA\nPOINTS {count} double\n'
    raw, cells = points.astype('>f8').tobytes(), b''.join(struct.pack('>4i', 3, *t) for t in triangles)
    yield write(tool.path('far.csv'), 'x,y,z\n' + '\n'.join(line.replace(' ', ',') for line in text))
    yield write(tool.path('far.ply'), ply.format('binary_big_endian') + 'end_header\n', raw)
    yield write(tool.path('far.mesh.ply'), ply.format('ascii') + f'element face {faces}\nproperty list uchar int vertex_indices\nend_header\n',
                '\n'.join([*text, *(f'3 {a} {b} {c}' for a, b, c in triangles)]))
    yield write(tool.path('far.vtk'), poly, raw, '\n')
    yield write(tool.path('far.mesh.vtk'), poly, raw, f'\nPOLYGONS {faces} {4 * faces}\n', cells, '\n')
    yield write(tool.path('far.vtu'), '<VTKFile type="UnstructuredGrid" byte_order="LittleEndian"><UnstructuredGrid>'
                f'<Piece NumberOfPoints="{count}" NumberOfCells="0"><Points><DataArray type="Float64" NumberOfComponents="3" format="ascii">',
                ' '.join(text), '</DataArray></Points></Piece></UnstructuredGrid></VTKFile>')


def check_far_elements(tool):
    """Points with the coordinates of a map keep their digits, and a warning names the shift; nothing is moved without need."""
    grid = numpy.array([[0.01 * i, 0.02 * j, 0.01 * i * j] for j in range(5) for i in range(6)])
    triangles = [t for j in range(4) for i in range(5) for a in (6 * j + i,) for t in ((a, a + 1, a + 6), (a + 1, a + 7, a + 6))]
    for path in far_files(tool, grid + [500000.123, 5400000.5, 100], triangles):
        tool.equal(path, [[[numpy.nan]]], warned='moved by (-500000, -5400000, -100)', spacing=[0.05, 0.08, 0.2], origin=[0.148, 0.54, 0.1])
    for path in far_files(tool, grid + [0.123, 5.5, 10], triangles):
        tool.equal(path, [[[numpy.nan]]], warned='', spacing=[0.05, 0.08, 0.2], origin=[0.148, 5.54, 10.1])
    tool.equal(write(tool.path('far.csv'), 'x,y,z\n' + '\n'.join(f'{1e9 + 0.1 * i:.1f},5,7' for i in range(11))), [[[numpy.nan]]],
               warned='add (1000000000, 0, 0)', origin=[0.5, 5, 7])
    tool.equal(write(tool.path('far.csv'), 'x,y,z\n' + '500000.1,5,7\n' * 3), [[[numpy.nan]]], warned='at one place, (500000', origin=[500000.1, 5, 7])
    tool.equal(write(tool.path('far.csv'), 'x,y,z\n' + '\n'.join(f'{500000 + i},5,7' for i in range(11))), [[[numpy.nan]]], warned='', origin=[500005, 5, 7])
    wanted = {'warned': 'moved by (-500000, -5400000, -100)', 'spacing': [0.05, 0.08, 0.2], 'origin': [0.148, 0.54, 0.1]}
    mesh = ''.join(f'v {500000.123 + x:.4f} {5400000.5 + y:.4f} {100 + z:.4f} 1 0 0\r\n' for x, y, z in grid) + ''.join(f'f {a + 1} {b + 1} {c + 1}\n' for a, b, c in triangles)
    tool.equal(write(tool.path('far.obj'), mesh), [[[numpy.nan]]], **wanted)
    facets = ''.join('facet normal 0 0 1\n outer loop\n' + ''.join('  vertex {:.4f} {:.4f} {:.4f}\n'.format(*(grid[k] + [500000.123, 5400000.5, 100]))
                                                                for k in t) + ' endloop\nendfacet\n' for t in triangles)
    for text in (facets, facets.replace('\n', ' '), facets.replace('\n', '\r\n'), facets.replace(' endloop\n', ' endloop ').replace('\n ', ' ')):
        tool.equal(write(tool.path('far.stl'), f'solid far\n{text}endsolid far\n'), [[[numpy.nan]]], **wanted)
    torn = mesh.replace(' ', ' ' * 100)  # the coordinates lie farther apart than they are looked for
    tool.equal(write(tool.path('far.obj'), torn), [[[numpy.nan]]], warned='rounded to steps of about 0.64')
    raw = b''.join(struct.pack('<12fH', 0, 0, 1, *(grid[list(t)] + [500000.123, 5400000.5, 100]).ravel(), 0) for t in triangles)
    tool.equal(write(tool.path('far.stl'), bytes(80) + struct.pack('<I', len(triangles)), raw), [[[numpy.nan]]], warned='rounded to steps of about 0.64')


def check(tool):
    SimpleITK.ProcessObject.SetGlobalWarningDisplay(False)
    for part in (check_vtk_legacy, check_vtk_components, check_vtk_xml, check_amira, check_vol, check_pvm, check_png, check_jpeg, check_far_elements):
        part(tool)
    for name in os.listdir(tool.folder):  # others would take the images for a stack
        if name.endswith(('.png', '.jpg')):
            os.remove(tool.path(name))
