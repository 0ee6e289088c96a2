// SPDX-License-Identifier: Apache-2.0
// Splats by tile and layer, and what is counted of them.
//
//   bin = tile · layers + layer      count[bin] ─► (20, 21) where its pairs begin ─► (22) end

layout(std430, binding = 7) coherent buffer Bins {
    uint splats;           // drawn, of the frame
    uint fragments, carry; // px inside their cutoffs: low and high word
    uint needed;           // pairs of the batch that had most
    uint total;            // pairs of this batch
    uint longest;          // pairs of the tile that had most in a batch
    uint planned;          // pairs of this batch, before they are counted by bin
    uint crowded;          // pairs of the longest bin that was not put in order
    uint widest;           // rounds of the splat that had most, of those that were left out for it
    uint unused[7];
    uint count[];
};

layout(location = 0) uniform uvec4 tiles;  // columns, first and last + 1 of the picture's rows, layers of the batch
