/* SPDX-License-Identifier: Apache-2.0
 *
 * SP_API marks the functions that the shared library exports; everything else is hidden.
 */
#ifndef SP_API_H
#define SP_API_H

#define SP_API __attribute__((visibility("default")))
/* Lets the compiler check printf-style arguments; first = 0 for a va_list. */
#define SP_PRINTF(text, first) __attribute__((__format__(__printf__, text, first)))

#endif
