/* How bright photos are beside others, of ties that are made up (brightness.h). test_agree.c has
 * photos. */
#include "unit.h"
#include <math.h>
#include <stdlib.h>
#include "near.h"
#include "scene/agreement.h"
#include "scene/brightness.h"
#include "scene/features.h"
#include "tests.h"

/* A pair has ties of what is kept and of what is cut away, of each as many as a photo has marks. */
static void test_most_ties(void **state)
{
    enum { MOST = 2 * CLN_FEATURES_MOST };
    cln_view views[3] = {{.camera = {.width = 8, .height = 8, .fx = 8, .fy = 8}}};
    cln_agree_view seen[3] = {{0}};
    cln_tie *ties = calloc(MOST + 3, sizeof *ties);
    cln_scene scene = {.views = views, .view_count = 3};
    cln_agreement agreement = {
        .views = seen, .ties = ties, .tie_count = MOST + 3, .pairs = 2, .focal = 1};

    (void)state;
    assert_non_null(ties);
    views[1] = views[2] = views[0];
    for (int i = 0; i < MOST; i++)
        ties[i] = (cln_tie){.a = 0, .b = 1, .value_a = 0.99f, .value_b = 0.49f, .agrees = true};
    for (int i = MOST; i < MOST + 3; i++)
        ties[i] = (cln_tie){.a = 1, .b = 2, .value_a = 0.5f, .value_b = 0.5f, .agrees = true};
    assert_int_equal(cln_agree_brightness(&scene, &agreement), CLN_OK);
    assert_near(seen[0].exposure - seen[1].exposure, 2.2, 1e-3);
    assert_near(seen[1].exposure - seen[2].exposure, 0, 1e-3);
    free(ties);
}

int test_group_brightness(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_most_ties)};

    return cmocka_run_group_tests_name("brightness", tests, NULL, NULL);
}
