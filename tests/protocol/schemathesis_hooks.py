# SPDX-License-Identifier: Apache-2.0
"""Hooks of schemathesis for protocol.schemathesis (schemathesis.toml names this file)."""
import re

import schemathesis

# Fields of a valid body that may break a rule which no schema can express; the descriptions of view.schema.json and
# openapi.yaml list the rules. '/size', '/volume', and the 'id' and 'color_by' of a layer depend on the daemon's limits and volumes.
BEYOND_SCHEMA = re.compile(
    r'(/keyframes/\d+)?(/view)?(/volume|/size(/[01])?|/camera(/position|/target|/up|/distance|/elevation)?|/filter/c_m(in|ax)'
    r'|/transfer_function/(points/\d+/value|gradient/\d+/magnitude|order)|/clip/box(/\d/\d)?|/clip/planes/\d/normal|/slices/(normal|in_3d)|/time/step'
    r'|/shading/(lights/\d/direction|occlusion|shadow)|/layers(/\d+/(type|low|id|transform|color_by|color_high|points/\d+/value))?|/compositing/mode|/filter|/edits/\d+/(type|normal|box/0/\d|range/0))|/from|/uri|/path|/source|/upload|/points(/\d)?|/range(/[01])?|/samples|/name|/unit|/value_unit|/direction(/[0-2])?|/dims|/memory|/frames|/keyframes/\d+(/(time|frame))?')

schemathesis.serializer.alias('application/offset+octet-stream', 'application/octet-stream')  # the parts of an upload


@schemathesis.check
def refusal_is_explained(context, response, case):
    """422 for a valid body names a field with a rule beyond the schema."""
    if response.status_code != 422 or not case.meta or not case.meta.generation.mode.is_positive:
        return
    pointer = response.json().get('pointer', '')
    if case.path.endswith(('/slice', '/histogram', '/files')) and not pointer:
        return  # parameters that exclude each other, or a time step that the volume lacks; the detail names them
    if not BEYOND_SCHEMA.fullmatch(pointer):
        raise AssertionError(f'the schema allows what the daemon refuses at "{pointer}": {response.json()["detail"]}')
