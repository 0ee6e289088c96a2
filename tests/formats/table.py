# SPDX-License-Identifier: Apache-2.0
"""The tables of renderer/data/import/types.md: which types and layouts were read, found by the tests themselves."""

TYPES = ['1 bit', 'int8', 'uint8', 'int16', 'uint16', 'int32', 'uint32', 'int64', 'uint64', 'float16', 'float32', 'float64', 'complex64',
         'complex128', 'RGB', 'RGBA']

HEAD = """# Types and layouts

`tests/formats` writes every row of these tables with an independent writer, reads it, and compares each sample with what the writer was given.
The page is written by `formats_test.py --write-page …`; the test fails if it differs from what was found.

## Types

The cells are the types in memory. All types of more than one byte were read in both byte orders where the format has both. Integers that no type of
memory holds become float64, and a warning says if one was rounded (above 2⁵³). Complex numbers become their magnitude, with a warning. Colours are
fields: red, green, blue, alpha. An empty cell: the format does not have the type, or no writer for it. SimpleITK writes PNG, JPEG, GIPL and some
files of VTK; the test writes other files of VTK, Amira, PVM and `.vol` byte by byte. OpenVDB is not in the table, because no library of the tests
writes it: `convert_part.py` compares what the daemon itself writes with OpenVDB's reader.
"""


class Table:
    """Collects the results of the parts. A row that failed is not in the table, so the page then also differs."""

    def __init__(self):
        self.types, self.layouts = {}, {}

    def add_type(self, name, kind, memory):
        column = self.types.setdefault(name, {})
        assert kind in TYPES, kind
        if memory not in column.setdefault(kind, memory).split(', '):
            column[kind] += f', {memory}'

    def add_layout(self, name, layout, result):
        self.layouts.setdefault(name, {})[layout] = result

    def joined(self, page):
        """The page with the rows of the formats that were tested in place of its own."""
        old = Table()
        names = []
        for line in page.splitlines():
            cells = [cell.strip() for cell in line.strip('|').split('|')] if line.startswith('| ') else []
            if cells and cells[0] == 'type':
                names = cells[1:]
            elif cells and cells[0] in TYPES:
                for name, cell in zip(names, cells[1:]):
                    for memory in filter(None, cell.split(', ')):
                        old.add_type(name, cells[0], memory)
            elif len(cells) == 3 and cells[0] != 'format':
                old.add_layout(*cells)
        old.types.update(self.types)
        old.layouts.update(self.layouts)
        return old.page()

    def page(self):
        names = sorted(self.types, key=str.lower)
        lines = [HEAD]
        for part in (names[i:i + 8] for i in range(0, len(names), 8)):
            lines += ['| type | ' + ' | '.join(part) + ' |', '|---' * (len(part) + 1) + '|']
            lines += [f'| {kind} | ' + ' | '.join(self.types[name].get(kind, '') for name in part) + ' |' for kind in TYPES]
            lines.append('')
        lines += ['## Layouts', '', '| format | layout | result |', '|---|---|---|']
        for name in sorted(self.layouts, key=str.lower):
            lines += [f'| {name} | {layout} | {result} |' for layout, result in self.layouts[name].items()]
        return '\n'.join(lines) + '\n'
