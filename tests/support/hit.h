/* SPDX-License-Identifier: Apache-2.0
 *
 * The hits that a reference renderer finds on a ray. Each layer has a reference renderer; mixed.h
 * composites the hits of all layers together.
 */
#ifndef TESTS_SUPPORT_HIT_H
#define TESTS_SUPPORT_HIT_H

enum { TEST_HITS_MAX = 64 }; /* per mesh and ray */

struct test_hit {
    double depth;    /* along the view direction, from the eye [world unit] */
    double color[3]; /* not multiplied by alpha */
    double alpha;
};

#endif
