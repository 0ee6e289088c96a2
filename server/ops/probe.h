/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SRV_PROBE_H
#define SRV_PROBE_H

#include <stdbool.h>
#include <stdio.h>

/* Prints what there is to render on, one paragraph each, and why the rest does not work. Returns
 * whether a GPU works. */
bool srv_probe(FILE *out);

#endif
