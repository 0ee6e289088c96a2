/* SPDX-License-Identifier: Apache-2.0 */
#include "data/volume/anatomy.h"

#include <string.h>

static const char pairs[3][2] = { { 'R', 'L' }, { 'A', 'P' }, { 'S', 'I' } };

/* The pair that a letter belongs to; -1 = none. */
static int pair_of(char letter) {
    for (int p = 0; p < 3; p++)
        if (letter == pairs[p][0] || letter == pairs[p][1])
            return p;
    return -1;
}

bool sp_anatomy_is_valid(const char letters[4]) {
    if (!letters[0])
        return !letters[1] && !letters[2] && !letters[3];
    unsigned seen = 0;
    for (int i = 0; i < 3; i++) {
        int pair = pair_of(letters[i]);
        if (pair < 0)
            return false;
        seen |= 1u << pair;
    }
    return seen == 7 && !letters[3];
}

bool sp_anatomy_find(const char letters[4], char direction, double vector[3]) {
    memset(vector, 0, 3 * sizeof *vector);
    for (int i = 0; i < 3 && letters[i]; i++)
        if (pair_of(letters[i]) == pair_of(direction)) {
            vector[i] = letters[i] == direction ? 1 : -1;
            return true;
        }
    return false;
}

bool sp_anatomy_is_left_handed(const char letters[4]) {
    double to[3][3];
    for (int i = 0; i < 3; i++)
        if (!sp_anatomy_find(letters, "LPS"[i], to[i]))
            return false;
    double volume = 0; /* of the three unit vectors: 1 or -1 */
    for (int i = 0; i < 3; i++)
        volume += to[0][i] * (to[1][(i + 1) % 3] * to[2][(i + 2) % 3] -
                              to[1][(i + 2) % 3] * to[2][(i + 1) % 3]);
    return volume < 0;
}

bool sp_anatomy_is_plain_stack(const struct sp_volume_info *info) {
    const struct sp_grid *g = &info->grid;
    for (int r = 0; r < 3; r++)
        for (int a = 0; a < 3; a++)
            if (g->origin[r] != 0 || g->direction[r][a] != (r == a))
                return false;
    return strncmp(info->source, "demo:", 5) != 0;
}
