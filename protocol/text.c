/* SPDX-License-Identifier: Apache-2.0 */
#include "protocol/text.h"

#include <stddef.h>
#include <stdint.h>

/* Ranges of hidden characters, rising. */
static const uint32_t hidden[][2] = {
    { 0x0001, 0x001F }, { 0x007F, 0x009F }, { 0x00AD, 0x00AD }, { 0x061C, 0x061C },
    { 0x180E, 0x180E }, { 0x200B, 0x200B }, { 0x200E, 0x200F }, { 0x2028, 0x202E },
    { 0x2060, 0x206F }, { 0xFEFF, 0xFEFF }, { 0xFFF9, 0xFFFB }, { 0xE0000, 0xE007F },
};

/* Reads one character and its length; a byte that begins none counts as a character. */
static uint32_t read_character(const unsigned char *c, size_t *length) {
    size_t more = *c >= 0xF0 ? 3 : *c >= 0xE0 ? 2 : *c >= 0xC0 ? 1 : 0;
    uint32_t character = more ? *c & (0x3Fu >> more) : *c;
    *length = 1;
    for (; *length <= more; ++*length) {
        if ((c[*length] & 0xC0) != 0x80)
            return 0xFFFD;
        character = character << 6 | (c[*length] & 0x3Fu);
    }
    return *c >= 0x80 && *c < 0xC0 ? 0xFFFD : character;
}

static bool is_hidden(uint32_t character) {
    for (size_t i = 0; i < sizeof hidden / sizeof *hidden; i++)
        if (character >= hidden[i][0] && character <= hidden[i][1])
            return true;
    return false;
}

bool proto_text_is_plain(const char *text) {
    size_t length;
    for (const unsigned char *c = (const unsigned char *)text; *c; c += length)
        if (is_hidden(read_character(c, &length)))
            return false;
    return true;
}

void proto_text_clean(char *text) {
    unsigned char *out = (unsigned char *)text;
    size_t length;
    for (const unsigned char *c = out; *c; c += length) {
        if (is_hidden(read_character(c, &length)))
            *out++ = ' ';
        else
            for (size_t i = 0; i < length; i++)
                *out++ = c[i];
    }
    *out = 0;
}
