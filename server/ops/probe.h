/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SRV_OPS_PROBE_H
#define SRV_OPS_PROBE_H

#include <stdbool.h>
#include <stdio.h>

/* Implements --probe: prints the devices that can render, one paragraph each, and why other devices
 * do not work. True if a GPU works. */
bool srv_probe(FILE *out);

#endif
