#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Reads the Prometheus text format from standard input with Prometheus' own Python client, checks more than it does, and prints
every family is told with its type and help before its samples, once, in one piece; histograms add up. Writes
{sample name with sorted labels: value} as JSON. Exit status 77: skipped."""
import json
import sys

try:
    from prometheus_client.parser import text_string_to_metric_families
except ImportError as e:
    print(f'skipped: {e}; install python3-prometheus-client')
    sys.exit(77)


def check_histogram(family):
    by_labels = {}
    for sample in family.samples:
        labels = {k: v for k, v in sample.labels.items() if k != 'le'}
        one = by_labels.setdefault(json.dumps(labels), {'buckets': []})
        if sample.name.endswith('_bucket'):
            one['buckets'].append((float(sample.labels['le']), sample.value))
        else:
            one[sample.name.rsplit('_', 1)[1]] = sample.value
    for labels, one in by_labels.items():
        bounds, counts = zip(*one['buckets'])
        assert list(bounds) == sorted(set(bounds)) and bounds[-1] == float('inf'), (labels, bounds)
        assert list(counts) == sorted(counts) and counts[-1] == one['count'], (labels, counts, one)
        assert one['sum'] >= 0 and (one['count'] > 0 or one['sum'] == 0), (labels, one)


def main():
    text = sys.stdin.read()
    assert text.endswith('\n')
    families, values = set(), {}
    for family in text_string_to_metric_families(text):
        name = family.name + ('_total' if family.type == 'counter' else '')
        assert name not in families, f'{name} occurs twice'
        assert family.documentation and family.type in ('counter', 'gauge', 'histogram'), name
        assert f'# TYPE {name} {family.type}\n' in text, name
        families.add(name)
        for sample in family.samples:
            assert sample.name == name or family.type == 'histogram', sample
            key = sample.name + ''.join(f',{k}={v}' for k, v in sorted(sample.labels.items()))
            assert key not in values, f'{key} occurs twice'
            values[key] = sample.value
        if family.type == 'histogram':
            check_histogram(family)
    json.dump({k: v if abs(v) != float('inf') else str(v) for k, v in values.items()}, sys.stdout)


if __name__ == '__main__':
    main()
