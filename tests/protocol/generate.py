# SPDX-License-Identifier: Apache-2.0
"""Generates requests from the contract: values that satisfy a JSON Schema, values that violate it, and whole requests of an
OpenAPI operation. One random number generator makes all choices, so a seed always gives the same requests.
"""
import copy
import json
import string
import urllib.parse

import jsonschema

TEXTS = ['', 'a', 'engine', 'Zoë', '🦊', 'x' * 127, 'x' * 128, '/', '~1', '%', '\x7f', '\n', '"', '..', '../../etc/passwd', 'null', '0']
# Strings for each pattern: a generator of strings from regular expressions would be longer than this whole file.
POSITIVE = '([1-9][0-9]{0,16}([.][0-9]{1,17})?|0[.]0{0,8}[1-9][0-9]{0,8})(e[-+]?[0-9]{1,2})?'
NUMBER = '[-+]?[0-9]{1,17}([.][0-9]{1,17})?(e[-+]?[0-9]{1,2})?'
PATTERNS = {
    '^[^\\u0000]*[.](nrrd|nhdr|dcm|ima|nii|nii[.]gz|hdr|mrcs?|map|ccp4|rec|st|ali|gipl|mg[hz]|mhd|mha|pvm|vdb|am|vol|longvol|vgi|h5|hdf5|he5|nxs|ims|nc|nc4|cdf|vtk|p?vt[irsup]|vtmb?|spz|csv|xyz|p3d|json|tiff?|lsm|stk|png|jpe?g|ply|stl|obj|gltf|glb|bricks)$': ['a.nrrd', 'größe.tif', '../../x.vti', '🦊.vtk', 'a\\b.tiff'],
    '^demo:[a-z-]+([?]size=[1-9][0-9]{0,3})?$': ['demo:engine?size=8', 'demo:phantom?size=8', 'demo:galaxy?size=9', 'demo:nothing'],
    '^[1-9][0-9]{0,3},[1-9][0-9]{0,3}$': ['16,8', '1,1', '64,64', '9999,1', '8192,1'],
    f'^{POSITIVE}$': ['1', '0.25', '100.5', '0.001', '2e-2'],
    f'^{NUMBER}(,{NUMBER}){{2}}$': ['0,0,1', '1.5,-2,8', '1e-9,3,-1e10', '+1,+2,+3', '0,0,0'],
    f'^{NUMBER},{POSITIVE}$': ['100,50', '-1e3,2.5', '0,1', '0,2e3'],
    '^[A-Za-z0-9._-]{1,64}$': ['warm', 'a.B-c_0', '..', 'x' * 64],
    '^[A-Za-z0-9._-]{1,127}$': ['warm', 'a.B-c_0', 'x' * 127],
    '^[A-Za-z0-9_-]{1,32}$': ['a', 'b-1', 'C_2', 'x' * 32],
    '^#[0-9a-fA-F]{6}$': ['#0080ff', '#ABCDEF'],
    '^#[0-9a-f]{6}$': ['#0080ff'],
    '^[0-9a-f]{16}$': ['0' * 16, 'f' * 16],
    '^[0-9a-f]{32}$': ['0' * 32, 'f' * 32],
    '^([0-9a-f]{16}|[0-9a-f]{32})$': ['0' * 16, 'f' * 32],
    '^[^\\u0000]*$': TEXTS,
    '^[^\\u0000]*[^\\u0000 ][^\\u0000]*$': ['a', 'GRÖSSE nrrd', ' * ? % & # ', '🦊', '\t', 'ä' * 255],
    '^(?!upload:)[^\\u0000]*$': [*TEXTS, 'demo:phantom?size=8', 'a/b.nrrd'],
    '^(?!demo:|upload:)[^\\u0000]*$': TEXTS,
    '^/': ['/camera/eye'],
    '^[^\\u0000/]*$': ['engine', 'Zoë', '🦊', 'x' * 127, '~1', '%', '"'],
}
PIXELS_MAX = 1 << 16  # of a requested image: larger images take time and test nothing about the contract


class Values:
    """Generates values of a schema; references are resolved in `document`."""

    def __init__(self, document, rng):
        self.document, self.rng = document, rng
        unknown = set(self._patterns(document)) - PATTERNS.keys()
        assert not unknown, f'add strings for these patterns of the contract to PATTERNS: {unknown}'

    @classmethod
    def _patterns(cls, node):
        children = node.values() if isinstance(node, dict) else node if isinstance(node, list) else []
        if isinstance(node, dict) and isinstance(node.get('pattern'), str):
            yield node['pattern']
        for child in children:
            yield from cls._patterns(child)

    def node(self, schema):
        while '$ref' in schema:
            target = self.document
            for token in schema['$ref'][2:].split('/'):
                target = target[token]
            schema = target
        return schema

    def validator(self, schema):
        return jsonschema.Draft202012Validator({**self.node(schema), 'components': self.document['components']})

    def valid(self, schema):
        schema = self.node(schema)
        if schema.get('allOf'):  # the first schema allows fields, the others forbid some of them
            first, *others = schema['allOf']
            value = self.valid(first)
            for other in others:
                for name in [n for n, allowed in other['properties'].items() if allowed is False]:
                    value.pop(name, None)
            return value
        if 'anyOf' in schema:
            return self.valid(self.rng.choice(schema['anyOf']))
        if 'const' in schema:
            return schema['const']
        if 'enum' in schema:
            return self.rng.choice(schema['enum'])
        kinds = schema.get('type', 'object' if 'properties' in schema else 'string')
        kinds = kinds if isinstance(kinds, list) else [kinds]
        kind = 'null' if 'null' in kinds and self.rng.random() < 0.1 else next(k for k in kinds if k != 'null')
        return getattr(self, f'_{kind}')(schema)

    def _null(self, _):
        return None

    def _boolean(self, _):
        return self.rng.random() < 0.5

    def _number(self, schema):
        low = schema.get('minimum', schema.get('exclusiveMinimum', -1000))
        high = schema.get('maximum', schema.get('exclusiveMaximum', max(low, 0) + 1000))
        step = 1e-3 if 'exclusiveMinimum' in schema else 0
        return self.rng.choice([low + step, high, self.rng.uniform(low + step, high), min(max(1, low + step), high)])

    def _integer(self, schema):
        low, high = schema.get('minimum', -1000), schema.get('maximum', 1000)
        return self.rng.choice([low, high, self.rng.randint(low, min(high, low + 100))])

    def _string(self, schema):
        short, long = schema.get('minLength', 0), schema.get('maxLength', 200)
        texts = PATTERNS[schema['pattern']] if 'pattern' in schema else [*TEXTS, 'x' * long]
        fits = [t for t in texts if short <= len(t) <= long]
        return self.rng.choice(fits)

    def _array(self, schema):
        least = schema.get('minItems', 0)
        count = self.rng.randint(least, max(least, min(schema.get('maxItems', 4), least + 3)))
        items = [self.valid(schema.get('items', {})) for _ in range(count)]
        if 'contains' in schema and not any(items):
            items[0] = 1
        return items

    def _object(self, schema):
        names = set(schema.get('required', []))
        if 'oneOf' in schema:
            chosen = self.rng.choice(schema['oneOf']).get('required', [])
            others = {n for one in schema['oneOf'] for n in one.get('required', [])} - set(chosen)
            names |= set(chosen)
        else:
            others = set()
        properties = schema.get('properties', {})
        names |= {n for n in properties if n not in others and self.rng.random() < 0.35}
        if 'not' in schema and set(schema['not']['required']) <= names:
            names.remove(self.rng.choice(schema['not']['required']))
        return {n: self.valid(properties[n]) for n in properties if n in names}

    def beside(self, schema):
        """Returns a value just outside a bound of the schema; junk if it has no bound."""
        schema = self.node(schema)
        if 'maximum' in schema or 'minimum' in schema or 'exclusiveMinimum' in schema:
            step = 1 if schema.get('type') == 'integer' else 1e-3
            low = schema.get('exclusiveMinimum', schema.get('minimum', 0) - step)
            return self.rng.choice([low, schema['maximum'] + step if 'maximum' in schema else low])
        if 'items' in schema:
            count = self.rng.choice([schema.get('minItems', 1) - 1, schema.get('maxItems', 64) + 1])
            return [self.valid(schema['items']) for _ in range(max(count, 0))]
        if 'maxLength' in schema:
            return self.rng.choice(['', 'x' * (schema['maxLength'] + 1)])
        return self.junk()

    def broken(self, value, schema):
        """Returns a copy of a valid value with one change, which the schema may or may not allow."""
        value = copy.deepcopy(value)
        places = []

        def walk(node, of):
            of = self.node(of)
            if isinstance(node, dict):
                places.append((node, self.rng.choice(['unknown', '', '/', 'x' * 300, 'Volume']), {}))
                children = [(key, of.get('properties', {}).get(key, {})) for key in node]
            else:
                children = [(i, of.get('items', {})) for i in range(len(node))] if isinstance(node, list) else []
            for key, child in children:
                places.append((node, key, child))
                walk(node[key], child)
        walk(value, schema)
        if not places:
            return self.beside(schema)
        node, key, of = self.rng.choice(places)
        node[key] = self.beside(of) if self.rng.random() < 0.5 else self.junk()
        return value

    def junk(self):
        return self.rng.choice([
            None, True, 0, -1, 1.5, 1e308, -1e308, 5e-324, 2 ** 53, 2 ** 64, [], {}, [None], [[[]]], {'a': {}}, *TEXTS,
            ''.join(self.rng.choice(string.printable) for _ in range(9)), [1, 2, 3], [0, 0], {'value': 1}])


class Requests:
    """Generates requests of operations."""

    def __init__(self, document, rng):
        self.document, self.rng = document, rng
        self.values = Values(document, rng)

    def request(self, template, method, ids):
        """Returns {path, headers, body, is_sound, has_id}. is_sound: the contract allows the request. `ids`: the ids that exist."""
        item = self.document['paths'][template]
        operation = item[method]
        made = {'path': template, 'headers': {}, 'body': None, 'is_sound': True, 'has_id': True}
        query = {}
        for parameter in map(self.values.node, item.get('parameters', []) + operation.get('parameters', [])):
            self._parameter(made, query, parameter, ids)
        if self.rng.random() < 0.3:  # to all operations: an operation that answers 304 must document it
            made['headers']['If-None-Match'] = self.rng.choice(['*', '"x"', 'W/"y", "z"', '', '"' * 50])
        if query:
            made['path'] += '?' + urllib.parse.urlencode(query)
        if 'requestBody' in operation:
            self._body(made, operation['requestBody'])
        return made

    def _parameter(self, made, query, parameter, ids):
        where, name = parameter['in'], parameter['name']
        if where == 'path':
            made['has_id'] = bool(ids) and self.rng.random() < 0.8
            schema = parameter['schema']
            others = ['nothing', '0' * 32, '..', '\0', 'x' * 200, '🦊', self.values.valid(schema) or 'a']
            value = self.rng.choice(ids if made['has_id'] else others)
            made['name'] = value
            made['is_sound'] &= value != '\0' and self.values.validator(schema).is_valid(value)
            made['path'] = made['path'].replace('{%s}' % name, urllib.parse.quote(str(value), safe=''))
        elif where == 'query' and self.rng.random() < 0.5:
            content = parameter.get('content', {}).get('application/json')
            schema = content['schema'] if content else parameter['schema']
            value = self.values.valid(schema) if self.rng.random() < 0.6 else self.values.broken(self.values.valid(schema), schema)
            if not content and not isinstance(value, (str, int)):
                value = str(value)
            text = json.dumps(value) if content else str(value)
            seen = value if content else self._read(text, schema)
            made['is_sound'] &= self.values.validator(schema).is_valid(seen)
            if not (content and text == 'null'):
                query[name] = text
        elif where == 'header' and name == 'Accept' and self.rng.random() < 0.3:
            made['headers'][name] = self.rng.choice(['image/png', 'image/*;q=0.5', '*/*', 'text/html', ';;,', 'image/webp;q=0, image/jpeg'])

    def _read(self, text, schema):
        """Returns a parameter as the schema sees it: a number if the schema wants one and the text is one."""
        if self.values.node(schema).get('type') == 'integer' and text.isascii() and text.isdigit():
            return int(text)
        return text

    def _body(self, made, described):
        kind = self.rng.choice(list(described['content']))
        schema = described['content'][kind]['schema']
        roll = self.rng.random()
        value = self.values.valid(schema)
        if roll > 0.5:
            for _ in range(self.rng.randint(1, 2)):
                value = self.values.broken(value, schema)
        made['headers']['Content-Type'] = kind
        self._keep_small(value)
        made['body'] = json.dumps(value)
        made['is_sound'] &= self.values.validator(schema).is_valid(value)
        if roll > 0.95:
            made['body'] = self.rng.choice(['{', 'null', '[]', '"x"', '{"a":1,"a":2}', '\x00', '{}{}', made['body'][:-1] + ' '])
            made['is_sound'] = False
        elif not value and not described.get('required') and roll < 0.05:
            made['body'] = None

    @staticmethod
    def _keep_small(value):
        for view in (value, value.get('view') if isinstance(value, dict) else None):
            size = view.get('size') if isinstance(view, dict) else None
            if isinstance(size, list) and len(size) == 2 and all(isinstance(n, int) for n in size) and size[0] * size[1] > PIXELS_MAX:
                view['size'] = [min(size[0], 256), min(size[1], 256)]
