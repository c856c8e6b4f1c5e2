/* The first calls of a process, from several threads at once: drivers may begin in one alone. Exit
 * code 0 if each finds a device. For tests/cli/install.sh, against the installed library. */
#define _POSIX_C_SOURCE 200809L
#include <cl_nascent.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>

enum { THREADS = 4 };

static void *list(void *user)
{
    pthread_barrier_t *together = user;
    cln_device_info *devices = NULL;
    int count = 0;

    pthread_barrier_wait(together);
    if (cln_devices_list(NULL, false, &devices, &count) != CLN_OK)
        fprintf(stderr, "%s\n", cln_error_text());
    free(devices);
    return count > 0 ? user : NULL;
}

int main(void)
{
    pthread_barrier_t together;
    pthread_t threads[THREADS];
    int found = 0;

    pthread_barrier_init(&together, NULL, THREADS);
    for (int i = 0; i < THREADS; i++)
        if (pthread_create(&threads[i], NULL, list, &together) != 0)
            return 2;
    for (int i = 0; i < THREADS; i++) {
        void *result = NULL;

        pthread_join(threads[i], &result);
        found += result != NULL;
    }
    return found == THREADS ? 0 : 1;
}
