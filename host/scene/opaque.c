/* Photos with an alpha channel that is opaque everywhere, as many tools write them: they cut out no
 * object, so they count as photos without one. As long as no pixel is found that is not opaque, all
 * of them are decoded for that, before their cube is chosen; mostly, the first has one. A run that
 * was begun with them knows it, so that they are not decoded again unless they have changed. */
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include "base/callbacks.h"
#include "base/log.h"
#include "io/image.h"
#include "scene/build.h"

typedef struct look {
    const cln_scene *scene;
    const cln_callbacks *callbacks;
    pthread_t thread; /* which calls them */
    atomic_int next;
    atomic_bool found, no_memory;
} look;

bool cln_image_is_opaque(const uint8_t *pixels, size_t count)
{
    for (size_t i = 0; i < count; i++)
        if (pixels[4 * i + 3] != 255)
            return false;
    return true;
}

/* A file that cannot be decoded tells nothing: it is refused when its pixels are wanted. */
static void look_at(look *l, const cln_view *view)
{
    int width = 0, height = 0, channels = 0;
    uint8_t *pixels = NULL;
    const cln_status st = cln_image_load(view->path, &width, &height, &channels, &pixels);

    if (st == CLN_MEMORY)
        atomic_store(&l->no_memory, true);
    if (st != CLN_OK)
        cln_clear_error();
    else if (channels == 4 && !cln_image_is_opaque(pixels, (size_t)width * (size_t)height))
        atomic_store(&l->found, true);
    free(pixels);
}

static cln_status look_on(look *l)
{
    while (!atomic_load(&l->found) && !atomic_load(&l->no_memory)) {
        const int i = atomic_fetch_add(&l->next, 1);

        if (i >= l->scene->view_count)
            break;
        if (pthread_equal(pthread_self(), l->thread)) {
            const cln_status st = cln_tell_work(l->callbacks, NULL, 0, 0);

            if (st != CLN_OK) {
                atomic_store(&l->next, l->scene->view_count);
                return st;
            }
        }
        if (l->scene->views[i].channels == 4)
            look_at(l, &l->scene->views[i]);
    }
    return CLN_OK;
}

static void *look_beside(void *argument)
{
    (void)look_on(argument);
    return NULL;
}

/* Decodes the views with 4 channels from `first` on, the first of them, until one is found that is
 * not opaque. */
static cln_status look_for(const cln_scene *scene, int first, const cln_callbacks *callbacks,
                           bool *found)
{
    cln_status st = CLN_OK;
    look l = {.scene = scene, .callbacks = callbacks, .thread = pthread_self()};
    pthread_t other;
    bool beside = false;

    look_at(&l, &scene->views[first]); /* alone: it is enough where it is not opaque */
    atomic_store(&l.next, first + 1);
    beside = !atomic_load(&l.found) && !pthread_create(&other, NULL, look_beside, &l);
    st = look_on(&l);
    if (beside)
        pthread_join(other, NULL);
    CLN_TRY(st);
    if (atomic_load(&l.no_memory))
        CLN_TRY(
            cln_fail(CLN_MEMORY,
                     "%s: no memory to decode its photos; make smaller copies of them, or close "
                     "other programs",
                     scene->folder));
    *found = atomic_load(&l.found);
done:
    return st;
}

cln_status cln_scene_find_opaque(cln_scene *scene, const cln_scene_desc *desc)
{
    cln_status st = CLN_OK;
    bool found = false;
    int first = 0;

    while (first < scene->view_count && scene->views[first].channels != 4)
        first++;
    for (int i = 0; i < scene->view_count; i++)
        if (scene->views[i].alpha_path)
            return CLN_OK;
    if (first == scene->view_count)
        return CLN_OK;
    if (!desc->opaque_digest)
        CLN_TRY(look_for(scene, first, desc->callbacks, &found));
    if (found)
        goto done;
    for (int i = first; i < scene->view_count; i++) {
        scene->views[i].opaque = scene->views[i].channels == 4;
        scene->views[i].channels = 3;
    }
    cln_info("%s: the alpha channels of its photos are opaque everywhere and count as none",
             scene->folder);
done:
    return st;
}

cln_status cln_scene_check_opaque(cln_scene *scene, const cln_scene_desc *desc)
{
    cln_status st = CLN_OK;
    int first = -1;

    if (!desc->opaque_digest || scene->digest == desc->opaque_digest || scene->hides)
        return CLN_OK;
    for (int i = scene->view_count - 1; i >= 0; i--) {
        if (!scene->views[i].opaque)
            continue;
        scene->views[i].channels = 4;
        first = i;
    }
    if (first >= 0)
        st = look_for(scene, first, desc->callbacks, &scene->hides);
    for (int i = 0; i < scene->view_count; i++)
        if (scene->views[i].opaque)
            scene->views[i].channels = 3;
    return st;
}
