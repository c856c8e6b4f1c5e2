/* Runs kernels/turns.cl, which the self-test alone needs: it is built for the call. */
#include "pipeline/stages.h"

cln_status cln_turns(cln_device *device, uint32_t n, uint32_t *out)
{
    cln_status st = CLN_OK;
    cln_program program = {.program = NULL};
    cl_kernel kernel = NULL;
    cln_buffer to = {0};
    const cl_uint turns = n;

    CLN_TRY(cln_program_build(device, "turns", NULL, &program));
    CLN_TRY(cln_kernel_create(&program, "turns", &kernel));
    CLN_TRY(cln_buffer_reserve(device, &to, sizeof *out, "turns of a loop"));
    CLN_TRY(CLN_LAUNCH(device, kernel, CLN_STAGE_OTHER, 1, 1, CLN_ARG(to.mem), CLN_ARG(turns)));
    CLN_TRY(cln_buffer_read(device, &to, 0, out, sizeof *out));
done:
    cln_buffer_free(device, &to);
    cln_kernel_free(&kernel);
    cln_program_free(&program);
    return st;
}
