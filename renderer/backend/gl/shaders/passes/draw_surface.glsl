// SPDX-License-Identifier: Apache-2.0
// Adds a surface to the fragments of a band (draw/layers/surface/tile.c): one work group per tile, one thread per pixel. Blocks come front
// to back; their footprints are staged in shared memory and summed in sheets. To keep dispatches short, a tile with many
// points takes several passes, each of which continues with the sheets of the previous one. The last pass makes fragments.

layout(local_size_x = TILE, local_size_y = TILE) in;
// By pixel of the band, then again by pixel, …: two words of four per sheet (weight, depth, –, – | normal), and one for the
// depth behind which nothing is seen.
layout(std430, binding = 3) buffer Sheets { vec4 sheet_words[]; };

layout(location = 1) uniform uvec4 part;     // width of the image [px]; points of a tile in this pass: first, end; 1 = first pass
layout(location = 2) uniform uvec3 capacity; // fragments that the buffer holds; words before those of pixels; 1 = last pass

const uint SHEETS = 4u;
const float FAR_AWAY = 1e30;

struct Sheet {
    float weight, depth; // sums
    vec3 normal;
};

shared Footprint staged[STAGED];
shared uint seen[STAGED / 32u];   // bits of the staged footprints that touch the tile
shared int farthest;              // depth behind which nothing of the tile is seen, as an integer that rises with it

uint thread;
vec2 at, corner; // the pixel's centre in the tile, the tile's corner in the image [px]
bool is_inside;
Sheet sheets[2u * SHEETS]; // by facing
float hidden;              // what is behind is not seen
Resolved sorted[2u * SHEETS]; // by depth
uint sorted_count;

void add_footprint(Footprint f) {
    vec2 d = at - f.place.xy;
    float p = d.x * (f.place.z * d.x + f.place.w * d.y) + f.shape.x * d.y * d.y;
    float depth = f.shape.z + dot(f.rest.xy, d), tolerance = f.shape.w;
    if (!(p < filter_of.z && depth - tolerance < hidden))
        return;
    float weight = f.shape.y * exp2(-p);
    uint l = SHEETS * uint(f.side.y), last = l + SHEETS - 1u;
    while (l < last && !(abs(depth * sheets[l].weight - sheets[l].depth) <= tolerance * sheets[l].weight))
        l++;
    sheets[l].weight += weight;
    sheets[l].depth += weight * depth;
    sheets[l].normal += weight * vec3(f.rest.zw, f.side.x);
}

// Finds what opaque sheets hide: what is behind a complete one, or behind several that let all rays in or all rays out together.
// Nothing will be added before `reached`.
void compute_hidden(float reached) {
    bool is_clipped = plane_counts.x != 0u || kind.y != 0u;
    float crossed = 0.0, last = -FAR_AWAY;
    for (uint i = 0u; i < 2u * SHEETS; i++) {
        Sheet own = sheets[i];
        float z = own.depth / max(own.weight, 1e-6);
        crossed += i < SHEETS ? own.weight : -own.weight;
        last = own.weight > 1e-6 ? max(last, z) : last;
        if (own.weight > FULL && (!is_clipped || clip_share(corner + at, z + sheet_of.w, own.normal) > 0.99))
            hidden = min(hidden, z);
    }
    if (!is_clipped && abs(crossed) > FULL && last < reached)
        hidden = min(hidden, last);
}

// Every thread must call it.
void add_entry(uint slot, uint number) {
    Block block = read_block(number);
    bool has_added = false;
    for (uint first = 0u; first < block.count; first += STAGED) {
        if (thread < STAGED / 32u)
            seen[thread] = 0u;
        barrier();
        if (first + thread < block.count && set_up(block, first + thread, corner, 0.5 * float(TILE), staged[thread]))
            atomicOr(seen[thread / 32u], 1u << (thread % 32u));
        barrier();
        for (uint w = 0u; w < STAGED / 32u; w++)
            for (uint left = seen[w]; left != 0u; left &= left - 1u) {
                add_footprint(staged[32u * w + uint(findLSB(left))]);
                has_added = true;
            }
        barrier();
    }
    if (has_added && kind.x != 0u)
        compute_hidden(block.depth - sheet_of.w);
}

void begin_entries() {
    if (thread == 0u)
        farthest = ordinal(-FAR_AWAY);
    barrier();
    if (is_inside)
        atomicMax(farthest, ordinal(hidden));
}

// Is the block seen in this tile?
bool is_wanted(uint number) {
    Block block = read_block(number);
    return touches(block.box.xy, block.box.zw, uvec2(corner)) &&
           block.depth - sheet_of.w <= from_ordinal(farthest) + sheet_of.z * bounds.z;
}

uint tile_word(uint i) {
    return surface_words[i];
}

// Orders sheets by depth. Of two sheets at nearly the same depth, as at an edge, the sheet that shows its outside comes first.
float order_of(Resolved sheet) {
    return sheet.depth + (sheet.side == OUTSIDE ? 0.0 : 0.3);
}

void sort_in(Resolved own) {
    bool is_moving = false;
    for (uint i = 0u; i < 2u * SHEETS; i++) {
        is_moving = is_moving || i == sorted_count || order_of(own) < order_of(sorted[i]);
        Resolved other = sorted[i];
        if (is_moving) {
            sorted[i] = own;
            own = other;
        }
    }
    sorted_count++;
}

// Adds the fragments of the pixel; returns whether there are any.
bool add_fragments() {
    bool has_any = false;
    float light = 1.0;
    sorted_count = 0u;
    for (uint i = 0u; i < 2u * SHEETS; i++) {
        Resolved own = resolve(corner + at, sheets[i].weight, sheets[i].depth, sheets[i].normal);
        own.side = i / SHEETS;
        if (own.coverage > LEAST)
            sort_in(own);
    }
    rays[OUTSIDE] = rays[INSIDE] = vec2(0);
    rays[UNKNOWN] = vec2(1);
    for (uint k = 0u; k < sorted_count && light > LEAST; k++) {
        Resolved own = sorted[k];
        float alpha = cross_sheet(own.side, own.coverage) / light;
        if (alpha > LEAST) {
            add_fragment(Fragment(own.depth * cell.x, vec4(own.color * alpha, alpha)));
            has_any = true;
        }
        light = rays[OUTSIDE].y + rays[INSIDE].y + rays[UNKNOWN].y;
    }
    return has_any;
}

void load_sheets(uint pixel, uint pixels) {
    for (uint i = 0u; i < 2u * SHEETS; i++) {
        vec4 sums = part.w != 0u ? vec4(0) : sheet_words[2u * i * pixels + pixel];
        vec4 side = part.w != 0u ? vec4(0) : sheet_words[(2u * i + 1u) * pixels + pixel];
        sheets[i] = Sheet(sums.x, sums.y, side.xyz);
    }
    hidden = part.w != 0u ? FAR_AWAY : sheet_words[4u * SHEETS * pixels + pixel].x;
}

void keep_sheets(uint pixel, uint pixels) {
    for (uint i = 0u; i < 2u * SHEETS; i++) {
        sheet_words[2u * i * pixels + pixel] = vec4(sheets[i].weight, sheets[i].depth, 0.0, 0.0);
        sheet_words[(2u * i + 1u) * pixels + pixel] = vec4(sheets[i].normal, 0.0);
    }
    sheet_words[4u * SHEETS * pixels + pixel] = vec4(hidden);
}

void main() {
    thread = gl_LocalInvocationIndex;
    is_perspective = choice.x != 0u;
    uvec2 px = gl_WorkGroupID.xy * TILE + gl_LocalInvocationID.xy;
    uint pixels = part.x * (tiles.z - tiles.y), pixel = px.y * part.x + px.x;
    is_inside = px.x < part.x && px.y < tiles.z - tiles.y;
    corner = vec2(gl_WorkGroupID.xy * TILE + uvec2(0u, tiles.y));
    at = vec2(gl_LocalInvocationID.xy) + 0.5;
    load_sheets(is_inside ? pixel : 0u, pixels);
    add_entries(uvec2(corner), kind.w, words.x, part.yz);
    if (capacity.z == 0u) {
        if (is_inside)
            keep_sheets(pixel, pixels);
        return;
    }
    load_fragments(capacity.y, is_inside ? pixel : 0u, pixels);
    store_fragments(is_inside && add_fragments(), capacity.y, capacity.x, pixel, pixels);
}
