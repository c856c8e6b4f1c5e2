/* Checks the folder of --kernel-dir. See kernel_dir.h. */
#include "device/kernel_dir.h"

#include <dirent.h>
#include <fnmatch.h>

#include "base/files.h"
#include "device/kernel_source.h"

/* Returns whether a folder has any of our files; without one, --kernel-dir would silently change
 * nothing. Any other .cl file counts too, as tests have kernels of their own. */
static bool has_kernels(const char *folder)
{
    bool has = false;
    DIR *listed = opendir(folder);
    const struct dirent *entry = NULL;

    for (const cln_kernel_source *k = cln_kernel_sources; k->name && !has; k++)
        has = cln_has_file(folder, k->name);
    while (listed && !has && (entry = readdir(listed)))
        has = fnmatch("*.cl", entry->d_name, FNM_PERIOD) == 0;
    if (listed)
        closedir(listed);
    return has;
}

cln_status cln_kernel_dir_check(const char *folder)
{
    if (folder && !cln_is_dir(folder))
        return cln_fail(CLN_INPUT,
                        "--kernel-dir %s: no such folder; leave the option out to use the kernels "
                        "in the binary",
                        folder);
    if (folder && !has_kernels(folder))
        return cln_fail(CLN_INPUT,
                        "--kernel-dir %s: it has no kernel file (such as rays.cl); give a copy of "
                        "the folder kernels/",
                        folder);
    return CLN_OK;
}
