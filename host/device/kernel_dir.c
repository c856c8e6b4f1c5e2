/* Checks the folder of --kernel-dir. See kernel_dir.h. */
#include "device/kernel_dir.h"

#include <dirent.h>
#include <fnmatch.h>
#include <stdio.h>
#include <string.h>

#include "base/files.h"
#include "base/log.h"
#include "base/text.h"
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

void cln_kernel_dir_say(const char *folder)
{
    char names[512] = "";
    size_t used = 0;

    for (const cln_kernel_source *k = cln_kernel_sources; folder && k->name; k++)
        if (cln_ends_with(k->name, ".cl") && !cln_has_file(folder, k->name) &&
            used + strlen(k->name) + 3 < sizeof names)
            used += (size_t)sprintf(names + used, "%s%s", used ? ", " : "", k->name);
    if (used)
        cln_info("kernels: not in %s, so the program's own: %s", folder, names);
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
