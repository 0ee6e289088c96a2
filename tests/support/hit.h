/* SPDX-License-Identifier: Apache-2.0
 *
 * What a reference finds on a ray: references of several layers give lists of hits, which are
 * composited together (mixed.h).
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
