/* The files of the page, embedded by make from page.html, page.css and the scripts: lines, ended
 * by NULL. */
#ifndef CLN_PAGES_H
#define CLN_PAGES_H

extern const char *const cln_page_html[];
extern const char *const cln_page_css[];
extern const char *const cln_page_js[];
extern const char *const cln_path_js[];
extern const char *const cln_crop_js[];
extern const char *const cln_training_js[];

#endif
