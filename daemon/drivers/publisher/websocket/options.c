/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/publisher/websocket/options.h"

#include <errno.h>
#include <string.h>
#include <sys/stat.h>

#include "base/log.h"
#include "base/macros.h"
#include "base/param.h"

/* They become part of a header. */
static int parse_connect(const char *text, void *field)
{
	const size_t length = strlen(text);

	if (length >= sizeof(((struct lp_websocket_options *)NULL)->connect) ||
	    strspn(text,
		   "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789:/.[]- *") !=
		    length)
		return -EINVAL;
	memcpy(field, text, length + 1);
	return 0;
}

static const struct lp_param list[] = {
	{"root", LP_PARAM_TEXT, offsetof(struct lp_websocket_options, root), .initial = "",
	 .max = 1024,
	 .help = "folder whose files are served by HTTP, index.html first; default: none"},
	{"origins", LP_PARAM_TEXT, offsetof(struct lp_websocket_options, origins), .initial = "",
	 .max = 1024,
	 .help = "origins whose pages may connect besides the probe's own, with commas between"},
	{"connect", LP_PARAM_OWN, offsetof(struct lp_websocket_options, connect), .initial = "",
	 .parse = parse_connect,
	 .expects = "origins of letters, digits and :/.[]-, with blanks between",
	 .help = "where the served page may connect besides this probe, like ws://127.0.0.1:7703"},
};
const struct lp_params lp_ws_params = {list, LP_COUNT(list), &lp_share_params};

static const struct lp_param wss_list[] = {
	{"pair", LP_PARAM_TEXT, offsetof(struct lp_websocket_options, pair), .initial = "",
	 .max = 1024,
	 .help = "folder with key, certificate and token, as lightprobe pair makes it"},
};
const struct lp_params lp_wss_params = {wss_list, LP_COUNT(wss_list), &lp_ws_params};

int lp_websocket_check_root(const char *object, const char *root)
{
	struct stat status;

	if (!*root || (stat(root, &status) == 0 && S_ISDIR(status.st_mode)))
		return 0;
	lp_error(object, "root", "%s: is no folder — make web builds the page in build/web", root);
	return -ENOTDIR;
}
