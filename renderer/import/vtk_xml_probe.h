/* SPDX-License-Identifier: Apache-2.0 */
#ifndef SP_IMPORT_VTK_XML_PROBE_H
#define SP_IMPORT_VTK_XML_PROBE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* probe() of struct import_format. */
bool vtk_xml_probe(const uint8_t *start, size_t size, const char *shown);

#endif
