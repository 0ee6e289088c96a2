/* SPDX-License-Identifier: Apache-2.0 */
#include "protocol/text.h"

bool proto_text_is_plain(const char *text) {
    for (const unsigned char *c = (const unsigned char *)text; *c; c++) {
        if (*c < 0x20 || *c == 0x7f || (c[0] == 0xc2 && c[1] < 0xa0) ||
            (c[0] == 0xd8 && c[1] == 0x9c)) /* U+061C */
            return false;
        unsigned last = c[0] == 0xe2 && (c[1] == 0x80 || c[1] == 0x81) ? c[1] * 256u + c[2] : 0;
        if (last == 0x808e || last == 0x808f || (last >= 0x80a8 && last <= 0x80ae) ||
            (last >= 0x81a6 && last <= 0x81a9)) /* U+200E, F, 2028 to E, 2066 to 9 */
            return false;
    }
    return true;
}
