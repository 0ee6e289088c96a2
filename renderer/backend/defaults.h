/* SPDX-License-Identifier: Apache-2.0
 *
 * Default limits of a renderer. They follow from the machine.
 */
#ifndef SP_BACKEND_DEFAULTS_H
#define SP_BACKEND_DEFAULTS_H

#include <stdint.h>

enum { SP_THREADS_MAX = 256 };

unsigned sp_default_threads(void); /* one per core, [1, SP_THREADS_MAX] */
uint64_t sp_default_memory(void);  /* half of the machine's memory, bytes; 1 GiB = not known */

#endif
