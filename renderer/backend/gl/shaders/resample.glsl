// SPDX-License-Identifier: Apache-2.0
// Constants of resampled sheets (struct gl_resample_constants in resample_constants.h), coordinates, and functions
// that read a sample of a mip level as a 16-bit code (draw/resample/curve.h). A tile has the axes u and v in its slices,
// and w across them.

// Samples of an axis, and rows of Places if they are not evenly spaced. EVEN: all axes are.
struct Axis {
    vec4 scale; // coordinate of the first row, rows per coordinate, largest distance of samples, coordinate at s = 0
    uvec4 rows; // samples, rows of the index (0 = evenly spaced), first row of coordinates, of the index
};

// A square of pixels with its own ray through the centre (draw/resample/rays.h).
struct Square {
    ivec4 kind;  // the first of its four parts (0 = it is not divided), w axis, backwards, sheets per slice (bits)
    vec4 at;     // u, v, du, dv
    vec4 turn;   // change of u and v to the right, and down
    vec4 fall;   // to the right, down; lever
    vec4 centre; // px
};

layout(std140, binding = 1) uniform Resample {
    vec4 to_world[3]; // rows
    vec4 metric[2];   // xx, yy, zz, rounding of gradients; yz, xz, xy, a depth inside the volume
    vec4 depths[3];   // by axis w: s at that depth of the centre's ray, forwards; its change by depth, to the right, down
    vec4 steep;       // between which rays get some half sheets
    vec4 smoothing;   // noise_square, keep_max (draw/resample/gradient.h); 1 = gradients are mixed
    vec4 code_scale; // codes per unit, base as two floats, lowest code
    vec4 bin_scale;   // bins per code, first bin; codes between which something is visible
    vec4 above_bins;
    vec4 numbers[2];  // of a projection (draw/resample/projection.h): sign, start, full, zero; absorption, gain, offset
    ivec4 choices;    // maximum or minimum; mean; leaves samples out
    ivec4 base;       // integers: the base's integer; linear attenuation; half spaces; points of the gradient axis
    uvec4 regions;    // per axis; axis of the bits of Visible
    uvec4 size;       // squares per row of the image; needs gradients; sides
    Axis axes[3];
    vec4 halves[HALVES]; // normal
    vec4 gaps[HALVES];   // by axis w: offset at s = 0
    vec4 faces[HALVES];  // unit normal of the face that it cuts (draw/resample/cut_face.h); 0 = it is a face of the volume
    vec4 magnitudes[MAGNITUDES]; // gradient axis: magnitude, scale
    vec4 sides[SIDES];   // of the silhouette (draw/resample/silhouette.h): x, y, distance at the image's corner
};
layout(std430, binding = 1) readonly buffer Squares { Square squares[]; };
layout(std430, binding = 2) readonly buffer Samples { uint samples[]; };
layout(std430, binding = 3) readonly buffer Visible { uint visible[]; }; // four regions per word
layout(std430, binding = 6) readonly buffer Places { float places[]; };

const float CODE_MIN = 1024.0, CODE_MAX = 31744.0; // enum of draw/resample/curve.h
const float FAR_CODE = 1e6;
const int REGION = 4;

int slices;        // the tile's axis w
bool is_backwards;
int per_slice;     // sheets that the pass draws
ivec3 dims, last;  // samples along u, v, w
uvec3 strides;

// An axis vector of the volume in the order u, v, w; and back.
vec3 turn(vec3 x) {
    return slices == 0 ? x.yzx : slices == 1 ? x.xzy : x.xyz;
}

vec3 turn_back(vec3 x) {
    return slices == 0 ? x.zxy : slices == 1 ? x.xzy : x.xyz;
}

int axis_of(int a) {
    return a == 2 ? slices : a == 0 ? (slices == 0 ? 1 : 0) : (slices == 2 ? 1 : 2);
}

void open_axis(int w, bool backwards, int sheets) {
    slices = w;
    is_backwards = backwards;
    per_slice = sheets;
    dims = ivec3(axes[axis_of(0)].rows.x, axes[axis_of(1)].rows.x, axes[w].rows.x);
    last = dims - 1;
    uvec3 by_axis = uvec3(1u, axes[0].rows.x, axes[0].rows.x * axes[1].rows.x);
    strides = uvec3(by_axis[axis_of(0)], by_axis[axis_of(1)], by_axis[w]);
}

// The slice that a sheet lies on, a multiple of ½; the first sheets lie before the volume.
float slice_of(int sheet) {
    float ahead = float(sheet) / float(per_slice) - 2.0;
    return is_backwards ? float(last.z) - ahead : ahead;
}

// s of a slice: along the rays.
float s_of(float z) {
    float place = z;
#if !EVEN
    Axis map = axes[slices];
    if (map.rows.y != 0u) {
        float step = max(map.scale.z, 1.0);
        int i = int(floor(z));
        if (z < 0.0)
            place = places[map.rows.z] + z * step;
        else if (i >= last.z)
            place = places[map.rows.z + uint(last.z)] + (z - float(last.z)) * step;
        else
            place = mix(places[map.rows.z + uint(i)], places[map.rows.z + uint(i) + 1u], z - float(i));
    }
#endif
    float s = place - axes[slices].scale.w;
    return is_backwards ? -s : s;
}

// The sample index at a coordinate along u or v, kept inside the slice.
float index_of(int a, float x) {
#if !EVEN
    Axis map = axes[axis_of(a)];
    if (map.rows.y != 0u) {
        x = clamp((x - map.scale.x) * map.scale.y, 0.0, float(map.rows.y));
        uint i = min(uint(x), map.rows.y - 1u), row = map.rows.w + i;
        x = places[row] + (x - float(i)) * (places[row + 1u] - places[row]);
    }
#endif
    return clamp(x, 0.0, float(last[a]));
}

vec2 index_of(vec2 x) {
    return vec2(index_of(0, x.x), index_of(1, x.y));
}

// The distance of the samples beside an index.
float spacing_at(int a, float index) {
#if EVEN
    return 1.0;
#else
    Axis map = axes[axis_of(a)];
    if (map.rows.y == 0u || last[a] == 0)
        return 1.0;
    uint row = map.rows.z + uint(min(int(index), last[a] - 1));
    return places[row + 1u] - places[row];
#endif
}

// The scale of the opacity at a gradient's magnitude.
float scale_of(float magnitude) {
    int n = base.w, i = 1;
    if (!(magnitude > magnitudes[0].x))
        return magnitudes[0].y;
    while (i < n && magnitudes[i].x <= magnitude)
        i++;
    if (i == n)
        return magnitudes[n - 1].y;
    vec2 low = magnitudes[i - 1].xy, high = magnitudes[i].xy;
    return mix(low.y, high.y, (magnitude - low.x) / (high.x - low.x));
}

#if SAMPLES == SAMPLES_INTEGER
float code_of(uint at) {
    const uint per_word = 4u / BYTES, bits = 8u * BYTES;
    uint word = samples[at / per_word], shift = bits * (at % per_word);
#if SIGNED
    int x = bitfieldExtract(int(word), int(shift), int(bits));
#else
    int x = int(bitfieldExtract(word, int(shift), int(bits)));
#endif
    // The difference of 32-bit integers is rounded once.
    float above = x >= base.x ? float(uint(x) - uint(base.x)) : -float(uint(base.x) - uint(x));
    precise float code = (above - code_scale.z) * code_scale.x + CODE_MIN;
    return BYTES == 4u ? clamp(code, -FAR_CODE, FAR_CODE) : code;
}
#elif SAMPLES == SAMPLES_REAL
float code_of(uint at) {
    uint word = samples[at];
    if ((word & 0x7f800000u) == 0x7f800000u)
        return 0.0;
    precise float code = ((uintBitsToFloat(word) - code_scale.y) - code_scale.z) * code_scale.x + CODE_MIN;
    return clamp(code, -FAR_CODE, FAR_CODE);
}
#else // codes, made by the processor
float code_of(uint at) {
    return uintBitsToFloat(samples[at]);
}
#endif
