/* What the files of inspect.h share. See inspection.h. */
#include "scene/inspection.h"

#include <math.h>
#include "base/number.h"
#include "io/json.h"

void cln_inspect_measure(const cln_inspection *in, const char *name, double value)
{
    json_object_set_new(in->measures, name, cln_json_real(value));
}

void cln_inspect_add(json_t *views, const cln_inspection *in, int view)
{
    json_array_append_new(views, json_string(in->scene->views[view].name));
}

double cln_inspect_median(double *values, int count)
{
    if (!count)
        return NAN;
    cln_reals_sort(values, count);
    return values[count / 2];
}
