# SPDX-License-Identifier: Apache-2.0
# The JavaScript package and the viewer. Both are built in a copy under build/js, so that node_modules and everything
# generated stay out of the sources.

JS := $(BUILD)/js
JS_SOURCES := $(wildcard clients/js/src/*.ts clients/js/test/*.ts clients/js/test/page/*.ts clients/js/*.json web/*)

.PHONY: web js test-js
$(JS)/installed: clients/js/package.json clients/js/package-lock.json clients/js/.npmrc | $(call apt,web) $(if $(shell command -v npm),,$(call apt,npm))
	@echo 'setup: JavaScript packages into $(JS) (clients/js/package-lock.json)'
	@mkdir -p $(JS) && cp clients/js/package.json clients/js/package-lock.json clients/js/.npmrc $(JS)
	@cd $(JS) && npm ci --silent
	@touch $@

$(JS)/built: $(JS)/installed $(JS_SOURCES) proto/lightprobe.proto
	@rm -rf $(JS)/src $(JS)/test $(JS)/web $(JS)/proto $(JS)/dist
	@cp -r clients/js/src clients/js/test clients/js/tsconfig.json $(JS)
	@mkdir -p $(JS)/src/gen $(JS)/proto && cp -r web $(JS)/web && cp proto/lightprobe.proto $(JS)/proto
	@cd $(JS) && npm run --silent generate && npm run --silent build
	@touch $@
js: $(JS)/built ## build the JavaScript package in build/js

$(BUILD)/web/index.html: $(JS)/built
	@mkdir -p $(@D) && cp web/index.html web/style.css $(@D)
	@cd $(JS) && node_modules/.bin/esbuild web/main.ts --bundle --format=esm --minify --legal-comments=linked \
		--target=es2022 --outfile=../web/main.js --log-level=warning
	@touch $@
web: $(BUILD)/web/index.html ## build the viewer in build/web: lightprobed --publish=ws:127.0.0.1:7701?root=build/web

test-js: web daemon $(STAMPS)/venv ## run the tests of the JavaScript package and the viewer, also in Chromium
	@cd $(JS) && npm test --silent
