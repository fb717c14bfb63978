/* SPDX-License-Identifier: Apache-2.0 */
#include "drivers/publisher/mqtt/options.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/log.h"
#include "base/macros.h"
#include "base/param.h"
#include "base/uri.h"

#define PORT ":1883"
#define PORT_TLS ":8883"

static const char *const kinds[] = {"ambient", "total", NULL};

#define FIELD(name) offsetof(struct lp_mqtt_options, name)
static const struct lp_param list[] = {
	{"login", LP_PARAM_TEXT, FIELD(login), .initial = "", .max = 1024,
	 .help = "file with the user name in its first line and the password in its second one"},
	{"rate", LP_PARAM_FLOAT, FIELD(wish.rate_hz), .initial = "10", .max = 1000,
	 .help = "estimates a second; 0: every one"},
	{"quiet_ms", LP_PARAM_INT, FIELD(wish.quiet_ms), .initial = "0", .max = 60000,
	 .help = "time between estimates while nothing changes; 0: they come as often as ever"},
	{"sh_order", LP_PARAM_INT, FIELD(wish.sh_order), .initial = "2", .max = 4,
	 .help = "order of the spherical harmonics"},
	{"max_lights", LP_PARAM_INT, FIELD(wish.max_lights), .initial = "4", .max = 8,
	 .help = "lamps in the list; the others are in the spherical harmonics"},
	{"kind", LP_PARAM_CHOICE, FIELD(kind), .initial = "ambient", .choices = kinds,
	 .help = "spherical harmonics without the lamps of the list, or with them"},
	{"key_light", LP_PARAM_BOOL, FIELD(wish.key_light), .initial = "0",
	 .help = "also the one light that stands for all"},
	{"area_lights", LP_PARAM_BOOL, FIELD(wish.area_lights), .initial = "0",
	 .help = "list area lights, too"},
	{"health_ms", LP_PARAM_INT, FIELD(wish.health_period_ms), .initial = "1000", .max = 3600000,
	 .help = "time between health messages; 0: none"},
};
const struct lp_params lp_mqtt_params = LP_PARAMS(list);

static const struct lp_param tls_list[] = {
	{"ca", LP_PARAM_TEXT, FIELD(ca), .initial = "", .max = 1024,
	 .help = "file with the certificate of the authority that vouches for the broker;\n"
		 "default: those that this system trusts"},
};
const struct lp_params lp_mqtts_params = {tls_list, LP_COUNT(tls_list), &lp_mqtt_params};

/* ---------------------------------------------------------------- files */

/* A regular file, or what a link leads to: nobody waits for a FIFO. NULL with errno. */
static FILE *open_regular(const char *path, struct stat *status)
{
	const int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
	FILE *file = NULL;

	if (fd < 0)
		return NULL;
	if (fstat(fd, status) == 0) {
		errno = EINVAL;
		if (S_ISREG(status->st_mode))
			file = fdopen(fd, "r");
	}
	if (!file)
		close(fd);
	return file;
}

/* A line without its end. False: there is none, or it is too long. */
static bool read_line(FILE *file, char *line, size_t size_bytes)
{
	size_t length;

	if (!fgets(line, (int)size_bytes, file))
		return false;
	length = strcspn(line, "\r\n");
	if (length + 1 == size_bytes)
		return false;
	line[length] = '\0';
	return true;
}

int lp_mqtt_login_read(const char *path, struct lp_mqtt_login *login, char *why, size_t size_bytes)
{
	struct stat status;
	FILE *file = open_regular(path, &status);
	bool is_whole;

	if (!file) {
		const int ret = -errno;

		(void)snprintf(why, size_bytes, "%s: %s — let this user read the file", path,
			       lp_strerror(ret));
		return ret;
	}
	is_whole = read_line(file, login->user, sizeof(login->user)) && *login->user &&
		   read_line(file, login->password, sizeof(login->password));
	(void)fclose(file);
	if (is_whole)
		return 0;
	(void)snprintf(
		why, size_bytes,
		"%s: needs two lines: the user name (up to 126 bytes), and the password (254)",
		path);
	return -EINVAL;
}

static int check_login(const char *object, const char *path)
{
	struct lp_mqtt_login login;
	struct stat status;
	char why[1200];
	int ret;

	if (!*path)
		return 0;
	ret = lp_mqtt_login_read(path, &login, why, sizeof(why));
	explicit_bzero(&login, sizeof(login));
	if (ret < 0)
		lp_error(object, "login", "%s", why);
	else if (stat(path, &status) == 0 && status.st_mode & S_IRWXO)
		lp_warning(object, "login",
			   "%s: every user of this machine can read it — chmod 600 it, and choose "
			   "another password",
			   path);
	return ret < 0 ? -EINVAL : 0;
}

static int check_ca(const char *object, const char *path)
{
	struct stat status;
	FILE *file = *path ? open_regular(path, &status) : NULL;

	if (file)
		(void)fclose(file);
	if (file || !*path)
		return 0;
	lp_error(object, "ca", "%s: %s — name the certificate of the broker's authority (PEM)",
		 path, lp_strerror(errno));
	return -EINVAL;
}

/* ---------------------------------------------------------------- address and topic */

static int parse_error(const char *object, const char *reason)
{
	lp_error(object, "parse", "must be %.*s:HOST[:PORT]/TOPIC: %s", (int)strcspn(object, ":"),
		 object, reason);
	return -EINVAL;
}

/* Each level has a name, and none is a wildcard. */
static int take_topic(struct lp_mqtt_options *options, const char *object, const char *topic)
{
	const size_t length = strlen(topic);

	if (length == 0 || length >= sizeof(options->topic))
		return parse_error(object, "the topic has 1 to 199 bytes");
	if (topic[0] == '/' || topic[length - 1] == '/' || strstr(topic, "//"))
		return parse_error(object, "each level of the topic has a name");
	if (topic[0] == '$')
		return parse_error(object, "topics with $ are the broker's own");
	for (size_t i = 0; i < length; i++) {
		if (strchr("+#", topic[i]) || (unsigned char)topic[i] < 0x20 || topic[i] == 0x7f)
			return parse_error(object, "no + # or control character in the topic");
	}
	memcpy(options->topic, topic, length + 1);
	return 0;
}

/* HOST or HOST:PORT, IPv6 in brackets. */
static int take_broker(struct lp_mqtt_options *options, const char *object, const char *text,
		       size_t length)
{
	char address[LP_HOST_BYTES + 16];
	const char *bracket = memchr(text, ']', length);
	const char *host_end = bracket ? bracket : text;
	const bool has_port = memchr(host_end, ':', length - (size_t)(host_end - text)) != NULL;
	const char *port = has_port ? "" : options->is_tls ? PORT_TLS : PORT;

	if (length == 0 || length >= LP_HOST_BYTES)
		return parse_error(object, "names no broker");
	(void)snprintf(address, sizeof(address), "%.*s%s", (int)length, text, port);
	return lp_tcp_address_parse(object, address, &options->broker);
}

static int take_rest(struct lp_mqtt_options *options, const char *object, const char *rest)
{
	const char *slash;
	int ret;

	if (strncmp(rest, "//", 2) == 0) /* as clients write it */
		rest += 2;
	slash = strchr(rest, '/');
	if (!slash)
		return parse_error(object, "names no topic");
	ret = take_broker(options, object, rest, (size_t)(slash - rest));
	return ret < 0 ? ret : take_topic(options, object, slash + 1);
}

int lp_mqtt_options_read(struct lp_mqtt_options *options, const struct lp_uri *uri)
{
	int ret;

	options->ca[0] = '\0'; /* mqtt: has no such key */
	ret = lp_uri_read(uri, options->is_tls ? &lp_mqtts_params : &lp_mqtt_params, options);

	if (ret == 0)
		ret = take_rest(options, uri->text, uri->rest);
	if (ret == 0)
		ret = check_login(uri->text, options->login);
	if (ret == 0)
		ret = check_ca(uri->text, options->ca);
	options->wish.total = options->kind == 1;
	return ret;
}

int lp_mqtt_check_open(const struct lp_tcp_address *broker, const char *object, bool insecure_lan)
{
	if (lp_tcp_address_is_loopback(broker))
		return 0;
	if (insecure_lan) {
		lp_warning(object, "open",
			   "light and password go over the network without encryption "
			   "(--insecure-lan)");
		return 1;
	}
	lp_error(object, "open",
		 "light and password would go over the network without encryption — use mqtts:, or "
		 "accept this with --insecure-lan");
	return -EACCES;
}
