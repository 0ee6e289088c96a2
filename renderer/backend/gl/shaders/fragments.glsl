// SPDX-License-Identifier: Apache-2.0
// Fragments of other layers (frame/fragments.h), sorted by depth.
//
//   words   planes of sheets (insert.glsl) | by pixel of the band: where its fragments begin << 5 | how many
//           | by fragment: depth, premultiplied red, green, blue, alpha

#ifndef FRAGMENTS_ACCESS
#define FRAGMENTS_ACCESS readonly
#endif
layout(std430, binding = 8) FRAGMENTS_ACCESS buffer Fragments { uint fragment_words[]; };

const uint FRAGMENT_WORDS = 5u, FRAGMENT_COUNT_BITS = 5u;

uint fragment_at, fragment_count; // of the pixel: its first word, how many
uint next_fragment;               // the first one that is not composited

// Finds the fragments of a pixel: sets fragment_at and fragment_count. The buffer begins with `planes` words
// about the sheets (insert.glsl); then follows one word for each of its `pixels`.
void open_fragments(uint planes, uint pixel, uint pixels) {
    uint own = fragment_words[planes + pixel];
    fragment_count = own & ((1u << FRAGMENT_COUNT_BITS) - 1u);
    fragment_at = planes + pixels + FRAGMENT_WORDS * (own >> FRAGMENT_COUNT_BITS);
}

float fragment_depth(uint i) {
    return uintBitsToFloat(fragment_words[fragment_at + FRAGMENT_WORDS * i]);
}

// Composites the next fragment behind a pixel: transmittance and premultiplied colour.
vec4 over_fragment(vec4 pixel) {
    uint at = fragment_at + FRAGMENT_WORDS * next_fragment;
    vec4 own = uintBitsToFloat(uvec4(fragment_words[at + 1u], fragment_words[at + 2u], fragment_words[at + 3u],
                                     fragment_words[at + 4u]));
    return vec4(pixel.x * (1.0 - own.w), pixel.yzw + pixel.x * own.xyz);
}
