// SPDX-License-Identifier: Apache-2.0
// Writes each record's number into the bins of its tiles. The order inside a bin is free, because a layer is a sum.

layout(local_size_x = GROUP) in;
layout(std430, binding = 1) readonly buffer Spans { uvec2 spans[]; };
layout(std430, binding = 2) readonly buffer Totals { uint totals[]; };
layout(std430, binding = 3) writeonly buffer Pairs { uint pairs[]; };
layout(location = 1) uniform uvec2 batch; // records, capacity in pairs

void main() {
    uint record = gl_GlobalInvocationID.x;
    if (record >= batch.x || total > batch.y)
        return;
    Span span = unpack_span(spans[record]);
    for (uint r = span.first.y; r <= span.last.y; r++)
        for (uint c = span.first.x; c <= span.last.x; c++)
            for (uint l = span.layers.x; l <= span.layers.y; l++) {
                uint bin = (r * tiles.x + c) * tiles.w + l;
                pairs[totals[bin / SCAN_BLOCK] + atomicAdd(count[bin], 1u)] =
                    record | (l - span.layers.x) << RECORD_BITS;
            }
}
