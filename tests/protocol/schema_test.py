#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Compares view.schema.json with the decoder.

  schema_test.py VIEW_TOOL PROTOCOL_DIR

Both check the examples, the default view, values on and beside each bound of the schema, and random patches. SQLite's
json_patch (RFC 7396) merges random sequences of patches as a reference. Exit status: 0 all agree, 1 a difference, 77 skipped.
"""
import glob
import json
import math
import os
import random
import sqlite3
import subprocess
import sys

try:
    import jsonschema
except ImportError:
    print('skipped: python3-jsonschema is not installed')
    sys.exit(77)

failures = 0


def check(ok, text):
    global failures
    if not ok:
        failures += 1
        print('FAILED:', text)


class Tool:
    """Runs the decoder through view_tool."""

    def __init__(self, path):
        self.process = subprocess.Popen([path], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
                                        encoding='utf-8')

    def apply(self, *patches):
        """Returns the view after the patches, or the error."""
        self.process.stdin.write(json.dumps(patches, ensure_ascii=False) + '\n')
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())

    def close(self):
        self.process.stdin.close()
        return self.process.wait(10)


def load(path):
    with open(path, encoding='utf-8') as f:
        return json.load(f)


def resolve(schema, node):
    return schema['$defs'][node['$ref'].rsplit('/', 1)[1]] if '$ref' in node else node


def check_documented(schema, node, default, path):
    """Checks that every field is described, and that fields and defaults equal the decoder's."""
    node = resolve(schema, node)
    if path:
        check(len(node.get('description', '')) > 5, f'{path} has no description')
    if 'default' in node:
        check(node['default'] == default, f'{path}: default {node["default"]} in the schema, {default} in the view')
    properties = node.get('properties')
    if properties is not None and isinstance(default, dict):
        # A field that only patches have is not part of a view.
        properties = {name: child for name, child in properties.items() if not child.get('x-patch-only')}
        check(set(properties) == set(default), f'{path}: fields differ: {set(properties) ^ set(default)}')
        check(node.get('additionalProperties') is False, f'{path} allows unknown fields')
        for name in set(properties) & set(default):
            check_documented(schema, properties[name], default[name], f'{path}/{name}')


def check_examples(tool, validator, folder):
    for path in sorted(glob.glob(f'{folder}/examples/valid/*.json')):
        errors = [e.message for e in validator.iter_errors(load(path))]
        check(not errors, f'{os.path.basename(path)}: {errors[:1]}')
        check('view' in tool.apply(load(path)), f'{os.path.basename(path)} is refused by the decoder')
    for path in sorted(glob.glob(f'{folder}/examples/invalid/*.json')):
        example = load(path)
        if 'view' in example:
            refused = not validator.is_valid(example['view'])
            check(refused == example['refused_by_schema'],
                  f'{os.path.basename(path)}: {"refused" if refused else "accepted"} by the schema')


# A valid item of each list, so that a value at a bound is valid on its own.
ITEMS = {
    'point': {'value': 0, 'color': [0, 0, 0], 'opacity': 0},
    'gradient_point': {'magnitude': 0, 'scale': 0},
    'light': {'direction': [0, 0, 1]},
    'plane': {'normal': [0, 0, 1], 'offset': 0},
}


def scalars(schema, node, make):
    """Yields each number or string of the schema as (its schema, function from a value to a patch)."""
    name = node.get('$ref', '').rsplit('/', 1)[-1]
    node = resolve(schema, node)
    kind = node.get('type', [])
    if 'properties' in node:
        for key, child in node['properties'].items():
            if name:
                yield from scalars(schema, child, lambda v, k=key: make({**ITEMS[name], k: v}))
            else:
                yield from scalars(schema, child, lambda v, k=key: make({k: v}))
    elif 'array' in kind and '$ref' in node['items']:
        yield from scalars(schema, node['items'], lambda v: make([v]))
    elif 'array' in kind:
        count = node['minItems']
        item = node['items']
        inner = [0, 0, 0] if item.get('type') == 'array' else item.get('minimum', 0)
        last = [1, 1, 1] if inner == [0, 0, 0] else inner
        for i in range(count):
            # The lower corner of a box stays 0 and the upper one 1, so that each bound is tested alone.
            rest = [inner if j == 0 else last for j in range(count)]
            yield from scalars(schema, item, lambda v, i=i, r=rest: make(r[:i] + [v] + r[i + 1:]))
    else:
        yield node, make


def probe_values(node):
    kinds = node.get('type', [])
    if 'enum' in node:
        names = [n for n in node['enum'] if n is not None]
        yield from names
        yield from (names[0].upper(), names[0][:-1], '', 0, True, [], {})
        return
    if 'string' in kinds:
        longest = node['maxLength']
        yield from ('', 'x', 'x' * longest, 'x' * (longest + 1), 5, True, [], {})
        return
    whole = kinds == 'integer'
    for key in ('minimum', 'maximum', 'exclusiveMinimum', 'exclusiveMaximum'):
        if key in node:
            b = node[key]
            beside = (b - 1, b + 1) if whole else (math.nextafter(b, -math.inf), math.nextafter(b, math.inf))
            # Colours and opacities are floats: a value within half a float step of a bound equals the bound.
            far = () if whole else (b - 1e-6 * max(abs(b), 1), b + 1e-6 * max(abs(b), 1))
            yield from (b, *far, b - 1, b + 1)
            if key.startswith('exclusive') or whole:
                yield from beside
    yield from (1, -1, '1', True, [1], {}, [])


def check_bounds(tool, validator, schema):
    count = 0
    for node, make in scalars(schema, schema, lambda v: v):
        for value in probe_values(node):
            patch = make(value)
            if 'c_max' in patch.get('filter', {}):
                patch['filter']['c_min'] = 5e-324  # below any c_max
            if patch.get('transfer_function', {}).get('order') == 'post':
                patch['compositing'] = {'mode': 'slab'}  # single splats are refused with post
            if patch.get('camera', {}).keys() & {'position', 'target', 'up', 'distance'}:
                # Only the type matters here; the examples cover degenerate cameras.
                if isinstance(value, (int, float)) and not isinstance(value, bool):
                    continue
            answer, by_schema = tool.apply(patch), validator.is_valid(patch)
            check(('view' in answer) == by_schema,
                  f'{json.dumps(patch)[:150]}: schema {"accepts" if by_schema else "refuses"}, decoder says '
                  f'{json.dumps(answer.get("error", "yes"))[:150]}')
            count += 1
    for name, node in (('points', 256), ('gradient', 16)):
        key = 'value' if name == 'points' else 'magnitude'
        item = ITEMS['point' if name == 'points' else 'gradient_point']
        for n in (0, 1, node, node + 1):
            patch = {'transfer_function': {name: [{**item, key: i} for i in range(n)]}}
            check(('view' in tool.apply(patch)) == validator.is_valid(patch), f'{n} {name}')
            count += 1
    return count


def random_patch(rng, node, schema, depth=0):
    """Returns a random patch that is mostly valid, with nulls."""
    patch = {}
    for name, child in schema['properties'].items() if depth == 0 else node['properties'].items():
        if rng.random() < (0.5 if depth == 0 else 0.6):
            continue
        child = resolve(schema, child)
        if child.get('x-patch-only'):
            continue  # is merged into other fields
        if rng.random() < 0.2:
            patch[name] = None
        elif 'properties' in child:
            patch[name] = random_patch(rng, child, schema, depth + 1)
        elif 'enum' in child:
            patch[name] = rng.choice(child['enum'])
        elif child.get('type') == ['boolean', 'null']:
            patch[name] = rng.random() < 0.5
        elif name in ('position', 'target', 'up'):
            patch[name] = [rng.uniform(-9, 9) + (300 if name == 'position' else 0) for _ in range(3)]
        elif name == 'points':
            patch[name] = [{'value': i + rng.random() / 2, 'color': [rng.random()] * 3, 'opacity': rng.random() * .9}
                           for i in range(rng.randint(1, 5))]
        elif name == 'lights':
            patch[name] = [{'direction': [1, 2, 3], 'space': 'world', 'color': [1, 0.5, 4]}] * rng.randint(0, 3)
        elif 'default' in child and not isinstance(child['default'], (int, float)):
            patch[name] = child['default']
        elif 'string' in child['type']:
            patch[name] = rng.choice(['a', 'b'])
        else:
            low = child.get('minimum', child.get('exclusiveMinimum', 0) + 0.5)
            patch[name] = rng.uniform(low, child.get('maximum', low + 2))
    return patch


def fill(view, default):
    """Replaces the fields that null removed by their defaults."""
    if not isinstance(default, dict):
        return default if view is None else view
    view = view or {}
    return {k: fill(view.get(k), v) for k, v in default.items()}


def same(a, b):
    """True if both are equal up to the rounding of colours and opacities to floats and short decimals."""
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(same(a[k], b[k]) for k in a)
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, (int, float)) and isinstance(b, (int, float)):
        return a == b or abs(a - b) <= 1.3e-7 * abs(a)
    return a == b


def difference(a, b, path=''):
    if isinstance(a, dict) and isinstance(b, dict):
        key = next(k for k in a | b if not same(a.get(k), b.get(k)))
        return difference(a.get(key), b.get(key), f'{path}/{key}')
    return f'{path} is {a}, should be {b}'


def check_merge(tool, schema, default, rounds):
    """Compares sequences of patches with SQLite's merge patch; nulls are replaced by defaults."""
    db = sqlite3.connect(':memory:')
    merged_count = 0
    rng = random.Random(7396)
    for _ in range(rounds):
        patches = [random_patch(rng, schema, schema) for _ in range(rng.randint(1, 4))]
        expected = default
        for patch in patches:
            text = db.execute('select json_patch(?, ?)', (json.dumps(expected), json.dumps(patch))).fetchone()[0]
            expected = fill(json.loads(text), default)
        answer = tool.apply(*patches)
        if 'view' in answer:
            merged_count += 1
            if not same(answer['view'], expected):
                check(False, f'merge: {difference(answer["view"], expected)}: {patches}'[:600])
    check(merged_count > rounds / 2, f'only {merged_count} of {rounds} random sequences were valid')
    return merged_count


def main():
    tool, folder = Tool(sys.argv[1]), sys.argv[2]
    schema = load(f'{folder}/view.schema.json')
    cls = jsonschema.Draft202012Validator
    cls.check_schema(schema)
    validator = cls(schema)
    default = tool.apply()['view']
    check(validator.is_valid(default), 'the default view is refused by the schema')
    check_documented(schema, schema, default, '')
    check_examples(tool, validator, folder)
    bounds = check_bounds(tool, validator, schema)
    merges = check_merge(tool, schema, default, 400)
    check(tool.close() == 0, 'view_tool failed')
    print(f'{bounds} values at bounds, {merges} merges compared, {failures} failures')
    return 1 if failures else 0


if __name__ == '__main__':
    sys.exit(main())
