#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks openapi.yaml, and compares it with the daemon's table of routes.

  openapi_test.py SOURCE_DIR

Every $ref resolves; every operation has an id, a summary and described answers; every schema is valid; the documented
operations and query parameters are those of server/http/routes.c; the errors use application/problem+json. Exit status 77:
skipped.
"""
import json
import re
import sys

try:
    import jsonschema
    import yaml
except ImportError as e:
    print(f'skipped: {e}; install python3-yaml and python3-jsonschema')
    sys.exit(77)

failures = 0
# Statuses that any request may get; 405 belongs to a path.
EVERYWHERE = {'400', '414', '429', '503'}
METHODS = {'get', 'post', 'patch', 'delete', 'put', 'options'}
# Requests that change nothing although their methods could; every other answer to a change says whether it is durable.
COMPUTES = {'render', 'measure', 'measureSession'}


def check(ok, text):
    global failures
    if not ok:
        failures += 1
        print('FAILED:', text)


def resolve(document, ref):
    node = document
    for token in filter(None, ref[2:].split('/')):
        node = node.get(token.replace('~1', '/').replace('~0', '~')) if isinstance(node, dict) else None
    return node


def walk(node, visit, path=''):
    visit(node, path)
    if isinstance(node, dict):
        for key, child in node.items():
            walk(child, visit, f'{path}/{key}')
    elif isinstance(node, list):
        for i, child in enumerate(node):
            walk(child, visit, f'{path}/{i}')


def check_node(document, view, used):
    def visit(node, path):
        if not isinstance(node, dict):
            return
        ref = node.get('$ref')
        if isinstance(ref, str) and ref.startswith('#/'):
            used.add(ref)
            check(resolve(document, ref) is not None, f'{path}: {ref} does not resolve')
        elif isinstance(ref, str):
            name, _, place = ref.partition('#')
            check(name == 'view.schema.json' and resolve(view, f'#{place or "/"}') is not None,
                  f'{path}: {ref} does not resolve to a published document')
        if isinstance(node.get('schema'), dict):
            try:
                jsonschema.Draft202012Validator.check_schema(node['schema'])
            except jsonschema.SchemaError as e:
                check(False, f'{path}/schema: {e.message}')
    return visit


def check_operations(document):
    ids = set()
    for path, item in document['paths'].items():
        check('x-other-methods' in item, f'{path} has no x-other-methods')
        for method in METHODS & item.keys():
            operation, name = item[method], f'{method.upper()} {path}'
            check(operation.get('operationId') not in ids, f'{name}: operationId is missing or used twice')
            ids.add(operation.get('operationId'))
            check(operation.get('summary'), f'{name} has no summary')
            for status in EVERYWHERE | ({'401', '403'} if operation.get('security') != [] else set()):
                check(status in operation['responses'], f'{name} does not describe {status}')
            for status, answer in operation['responses'].items():
                answer = resolve(document, answer['$ref']) if '$ref' in answer else answer
                check(isinstance(status, str), f'{name}: status {status} is not a string')
                check(answer.get('description'), f'{name} {status} has no description')
                if int(status) >= 400:
                    check(list(answer.get('content', {})) == ['application/problem+json'],
                          f'{name} {status} is not a problem document')
                if method in METHODS - {'get', 'options'} and int(status) < 300 and operation['operationId'] not in COMPUTES:
                    check('X-Durable' in answer.get('headers', {}), f'{name} {status} does not say whether the change is durable')
            named = {p for p in re.findall(r'\{(\w+)\}', path)}
            declared = set()
            for p in item.get('parameters', []) + operation.get('parameters', []):
                p = resolve(document, p['$ref']) if '$ref' in p else p
                if p['in'] == 'path':
                    declared.add(p['name'])
            check(named == declared, f'{name}: parameters {declared} declared, {named} in the path')


def query_parameters(document, item, operation):
    """The names of an operation's query parameters."""
    parameters = item.get('parameters', []) + operation.get('parameters', [])
    parameters = [resolve(document, p['$ref']) if '$ref' in p else p for p in parameters]
    return frozenset(p['name'] for p in parameters if p['in'] == 'query')


def read_routes(source):
    """{(method, path pattern, names of the query parameters)} of the daemon's table."""
    with open(f'{source}/server/http/routes.c', encoding='utf-8') as f:
        text = f.read()
    queries = {name: frozenset(re.findall(r'"(\w+)"', list_)) for name, list_ in re.findall(r'#define ([A-Z_]+) \{(.*?)\}', text, re.DOTALL)}
    rows = re.findall(r'\{ SRV_(\w+), "([^"]+)", SRV_RIGHT_\w+,\s*\w+,\s*([A-Z_]+) \}', text)
    return {(method, path, queries[query]) for method, path, query in rows}


def check_routes(document, source):
    routed = read_routes(source)
    check(len(routed) > 5, 'the table of routes in server/http/routes.c could not be parsed')
    documented = {(method.upper(), re.sub(r'\{\w+\}', '{}', path), query_parameters(document, item, item[method]))
                  for path, item in document['paths'].items() for method in METHODS & item.keys()}
    for method, path, query in sorted(routed ^ documented, key=str):
        where = 'not documented' if (method, path, query) in routed else 'not routed'
        check(False, f'{method} {path} with the query parameters {sorted(query)} is {where}')


def main():
    source = sys.argv[1]
    with open(f'{source}/protocol/openapi.yaml', encoding='utf-8') as f:
        document = yaml.safe_load(f)
    json.dumps(document)  # no dates or other types that JSON lacks
    check(document['openapi'].startswith('3.1'), 'not OpenAPI 3.1')
    with open(f'{source}/protocol/view.schema.json', encoding='utf-8') as f:
        view = json.load(f)
    used = set()
    walk(document, check_node(document, view, used))
    for kind, parts in document['components'].items():
        for name in parts:
            check(kind == 'securitySchemes' or f'#/components/{kind}/{name}' in used, f'{kind}/{name} is not used')
    for name, schema in document['components']['schemas'].items():
        jsonschema.Draft202012Validator.check_schema(schema)
    check_operations(document)
    check_routes(document, source)
    print(f'{len(document["paths"])} paths, {len(used)} references, {failures} failures')
    return 1 if failures else 0


if __name__ == '__main__':
    sys.exit(main())
