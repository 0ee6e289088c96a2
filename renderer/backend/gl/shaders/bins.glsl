// SPDX-License-Identifier: Apache-2.0
// Splats by tile and layer, and their counters.
//
//   bin = tile · layers + layer      count[bin] ─► (20, 21) where its pairs begin ─► (22) end

layout(std430, binding = 7) coherent buffer Bins {
    uint splats;           // drawn in the frame
    uint fragments, carry; // px inside their cutoffs: low and high word
    uint needed;           // most pairs of a batch
    uint total;            // pairs of this batch
    uint longest;          // most pairs of a tile in a batch
    uint planned;          // pairs of this batch, before they are counted by bin
    uint crowded;          // pairs of the longest bin that was too long to sort
    uint widest;           // most rounds of a splat that was left out because of them
    uint stored;           // fragments of other layers
    uint longest_elements; // as `longest`, of other layers
    uint unused[5];
    uint count[];
};

layout(location = 0) uniform uvec4 tiles;  // columns; first row of the image and last + 1; layers of the batch
