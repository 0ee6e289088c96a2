// SPDX-License-Identifier: Apache-2.0
// Writes each record's number into the bins of its tiles. Inside a bin the order is free: a sheet sums.

layout(local_size_x = GROUP) in;
layout(std430, binding = 1) readonly buffer Spans { uvec2 spans[]; };
layout(std430, binding = 2) readonly buffer Totals { uint totals[]; };
layout(std430, binding = 3) writeonly buffer Pairs { uint pairs[]; };
layout(location = 1) uniform uvec2 batch; // records, room for pairs

void main() {
    uint record = gl_GlobalInvocationID.x;
    if (record >= batch.x || total > batch.y)
        return;
    uvec2 span = spans[record], first = uvec2(span.x, span.x >> 10) & 1023u;
    uvec2 last = uvec2(span.y, span.y >> 10) & 1023u;
    uint layer = span.x >> 20 | span.y >> 20 << 12;
    for (uint r = first.y; r <= last.y; r++)
        for (uint c = first.x; c <= last.x; c++) {
            uint bin = (r * tiles.x + c) * tiles.w + layer;
            pairs[totals[bin / SCAN_BLOCK] + atomicAdd(count[bin], 1u)] = record;
        }
}
