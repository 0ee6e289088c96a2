/* SPDX-License-Identifier: Apache-2.0
 *
 * Measurements as CSV, one per line.
 *
 * Why not a library: writing RFC 4180 takes the twenty lines of put_text(), and no CSV library that
 * Debian packages for C neutralises formulas.
 */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "protocol/measure.h"

/* Writes a field that a person may have written. */
static void put_text(FILE *out, const char *text) {
    const bool is_formula = *text && strchr("=+-@\t\r", *text);
    const bool is_quoted = strpbrk(text, ",\"\r\n") || is_formula;
    if (is_quoted)
        fputc('"', out);
    if (is_formula)
        fputc('\'', out);
    for (; *text; text++) {
        if (*text == '"')
            fputc('"', out);
        fputc(*text, out);
    }
    if (is_quoted)
        fputc('"', out);
}

/* Writes the shortest of the decimals with 15 to 17 digits that reads back as the same double; an
 * empty field if it is not finite. */
static void put_number(FILE *out, double value) {
    char text[32];
    for (int digits = 15; digits <= 17; digits++) {
        snprintf(text, sizeof text, "%.*g", digits, value);
        if (strtod(text, NULL) == value)
            break;
    }
    fputs(isfinite(value) ? text : "", out);
}

static void put_line(FILE *out, const struct proto_measure *m) {
    const struct sp_measure_result *result = &m->value.result;
    const struct sp_statistics *s = &result->statistics;
    char unit[SP_UNIT_BYTES + 2];
    const double numbers[] = { s->mean, s->deviation, s->min, s->max };
    proto_measure_unit(&m->value, unit);
    fprintf(out, "%s,%s,", m->id, sp_measure_kind_name(m->geometry.kind));
    put_text(out, m->volume);
    fputc(',', out);
    put_text(out, m->text);
    fputc(',', out);
    put_text(out, m->author);
    fprintf(out, ",%s,%s,", m->color, m->is_hidden ? "true" : "false");
    put_number(out, result->has_value ? result->value : NAN);
    fputc(',', out);
    put_text(out, unit);
    if (result->has_statistics)
        fprintf(out, ",%" PRIu64 ",%" PRIu64, s->count, s->nonfinite);
    else
        fputs(",,", out);
    for (unsigned i = 0; i < sizeof numbers / sizeof *numbers; i++) {
        fputc(',', out);
        put_number(out, result->has_statistics && s->count > 0 ? numbers[i] : NAN);
    }
    for (unsigned i = 0; i < SP_MEASURE_POINTS * 3; i++) {
        fputc(',', out);
        put_number(out, i / 3 < sp_measure_point_count(m->geometry.kind)
                            ? m->geometry.points[i / 3][i % 3]
                            : NAN);
    }
    fputs("\r\n", out);
}

char *proto_measures_to_csv(const struct proto_measure *measures, size_t count, size_t *size) {
    char *text = NULL;
    FILE *out = open_memstream(&text, size);
    if (!out)
        return NULL;
    fputs("id,kind,volume,text,author,color,hidden,value,unit,count,nonfinite,mean,deviation,min,"
          "max,x1,y1,z1,x2,y2,z2,x3,y3,z3\r\n",
          out);
    for (size_t i = 0; i < count; i++)
        put_line(out, &measures[i]);
    const bool has_failed = ferror(out) != 0;
    if (fclose(out) != 0 || has_failed) {
        free(text);
        return NULL;
    }
    return text;
}
