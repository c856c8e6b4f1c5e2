/* Trains a scene and measures it on its held-out views.
 *   cc train.c $(pkg-config --cflags --libs cl-nascent) -o train
 *   ./train SCENE RUN [NAME=VALUE...]          settings, such as steps=2000 or width=64
 * Ctrl-C ends it with a checkpoint; the same call then resumes the run. */
#include <cl_nascent.h>

#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

static volatile sig_atomic_t stop; /* the received signal, or 0 */

static void on_signal(int number)
{
    stop = number;
}

/* Called at every step: returns 0, or the signal that ends the training. */
static int interrupted(void *user)
{
    (void)user;
    return stop;
}

static void progress(const cln_train_progress *p, void *user)
{
    (void)user;
    if (p->step % 100 == 0)
        printf("step %lld, %.0f %%: loss %.4f, training PSNR %.1f dB, %d leaves\n",
               (long long)p->step, 100 * p->fraction, p->loss, p->psnr_train, p->leaves);
}

static void log_line(cln_log_level level, const char *line, void *user)
{
    (void)level;
    (void)user;
    fprintf(stderr, "%s\n", line);
}

/* "width=64" */
static cln_status set(cln_settings *settings, const char *argument)
{
    char name[64];
    const size_t length = strcspn(argument, "=");

    snprintf(name, sizeof name, "%.*s", (int)length, argument);
    return cln_settings_set(settings, name, argument[length] ? argument + length + 1 : "yes");
}

static cln_status train(const char *scene, const char *run, cln_settings *settings, bool resume)
{
    const cln_train_desc desc = {.scene = scene,
                                 .run = run,
                                 .resume = resume,
                                 .settings = settings,
                                 .callbacks = {.train = progress, .interrupted = interrupted}};
    cln_train_result result;
    const cln_status st = cln_train(&desc, &result);

    if (st == CLN_OK)
        printf("%lld steps in %.0f s, %d leaves\n", (long long)result.step, result.seconds,
               result.leaves);
    return st;
}

static cln_status measure(const char *run)
{
    const cln_eval_desc desc = {.run = run, .split = "test"};
    cln_eval_result result;
    const cln_status st = cln_eval(&desc, &result);

    if (st != CLN_OK)
        return st;
    for (int i = 0; i < result.count; i++)
        printf("%s: %.2f dB\n", result.images[i].name, result.images[i].psnr);
    printf("mean: %.2f dB, SSIM %.4f\n", result.psnr, result.ssim);
    cln_eval_free(&result);
    return CLN_OK;
}

int main(int argc, char **argv)
{
    cln_settings *settings = NULL;
    cln_status st = CLN_OK;
    struct stat info;
    bool resume = false;

    if (argc < 3) {
        fprintf(stderr, "usage: %s SCENE RUN [NAME=VALUE...]\n", argv[0]);
        return 2;
    }
    cln_log_to(CLN_LOG_WARN, log_line, NULL);
    signal(SIGINT, on_signal);
    resume = stat(argv[2], &info) == 0;
    st = resume ? cln_settings_of_run(argv[2], &settings) : cln_settings_create(NULL, &settings);
    for (int i = 3; i < argc && st == CLN_OK; i++)
        st = set(settings, argv[i]);
    if (st == CLN_OK)
        st = train(argv[1], argv[2], settings, resume);
    if (st == CLN_OK)
        st = measure(argv[2]);
    if (st != CLN_OK)
        fprintf(stderr, "%s: %s\n", argv[0],
                *cln_error_text() ? cln_error_text() : cln_status_phrase(st));
    cln_settings_free(settings);
    return cln_status_exit_code(st);
}
