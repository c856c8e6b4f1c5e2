/* Cameras as members of a transforms JSON file. See transforms_write.h. */
#include "scene/transforms_write.h"

bool cln_transforms_put_camera(json_t *to, const cln_camera *c)
{
    const cln_lens_model *lens = &cln_lens_models[c->lens];
    const struct {
        const char *key;
        double value;
    } numbers[] = {{"fl_x", c->fx}, {"fl_y", c->fy}, {"cx", c->cx}, {"cy", c->cy}};
    int lost = json_object_set_new(to, "w", json_integer(c->width)) |
               json_object_set_new(to, "h", json_integer(c->height));

    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++)
        lost |= json_object_set_new(to, numbers[i].key, json_real(numbers[i].value));
    for (int i = 0; i < lens->count; i++)
        lost |= json_object_set_new(to, lens->params[i], json_real(c->distortion[i]));
    return lost == 0;
}

json_t *cln_transforms_new_frame(const char *file_path, const cln_camera *camera, double scale)
{
    static const double flip[3] = {1, -1, -1}; /* camera axes: OpenCV's to OpenGL's */
    json_t *rows = json_array();
    json_t *frame = json_pack("{s:s, s:o}", "file_path", file_path, "transform_matrix", rows);
    int lost = 0;

    for (int r = 0; frame && r < 4; r++) {
        const double *row = r < 3 ? camera->c2w + 4 * r : (const double[4]){0, 0, 0, 1};

        lost |=
            json_array_append_new(rows, json_pack("[f,f,f,f]", row[0] * flip[0], row[1] * flip[1],
                                                  row[2] * flip[2], r < 3 ? row[3] * scale : 1.0));
    }
    if (lost) {
        json_decref(frame);
        frame = NULL;
    }
    return frame;
}
