# SPDX-License-Identifier: Apache-2.0
# The JavaScript package and the viewer. Both are built in a copy under build/js, so that node_modules and everything
# generated stay out of the sources.

JS := $(BUILD)/js
JS_SOURCES := $(wildcard clients/js/src/*.ts clients/js/src/*/*.ts clients/js/test/*.ts clients/js/test/page/*.ts clients/js/test/page/*.js clients/js/*.json web/*)

.PHONY: web js test-js
$(JS)/installed: clients/js/package.json clients/js/package-lock.json clients/js/.npmrc | $(call apt,build) $(if $(shell command -v npm),,$(call apt,npm))
	@echo 'setup: JavaScript packages into $(JS) (clients/js/package-lock.json)'
	@mkdir -p $(JS) && cp clients/js/package.json clients/js/package-lock.json clients/js/.npmrc $(JS)
	@cd $(JS) && npm ci --silent
	@touch $@

$(JS)/built: $(JS)/installed $(JS_SOURCES) proto/lightprobe.proto proto/ranges.toml proto/ranges.py proto/ranges_code.py proto/flags_code.py host_py/lightprobe/estimate.py
	@rm -rf $(JS)/src $(JS)/test $(JS)/web $(JS)/proto $(JS)/dist
	@cp -r clients/js/src clients/js/test clients/js/tsconfig.json clients/js/tsconfig.engines.json $(JS)
	@mkdir -p $(JS)/src/gen $(JS)/proto && cp -r web $(JS)/web && cp proto/lightprobe.proto $(JS)/proto
	@$(PYTHON) proto/ranges_code.py --typescript $(JS)/src/gen/ranges.ts
	@$(PYTHON) proto/flags_code.py --typescript $(JS)/src/gen/flag_words.ts
	@cd $(JS) && npm run --silent generate && npm run --silent build && npm run --silent bundle
	@touch $@
js: $(JS)/built ## build the JavaScript package in build/js

$(BUILD)/web/index.html: $(JS)/built
	@mkdir -p $(@D) && cp web/*.html web/*.css $(JS)/dist/lightprobe-webxr.js $(@D)
	@cd $(JS) && node_modules/.bin/esbuild web/main.ts --bundle --format=esm --minify --legal-comments=linked \
		--target=es2022 --outfile=../web/main.js --log-level=warning
	@cd $(JS) && for package in three js-aruco2 fzstd; do printf '\n%s\n\n' "$$package"; cat node_modules/$$package/LICENSE*; done >> ../web/main.js.LEGAL.txt
	@cd $(JS) && node_modules/.bin/esbuild web/reader.ts --bundle --format=iife --minify --target=es2022 \
		--legal-comments=eof --outfile=../web/reader.js --log-level=warning
	@cd $(JS) && node_modules/.bin/esbuild web/setup.ts --bundle --format=esm --minify --target=es2022 \
		--outfile=../web/setup.js --log-level=warning
	@cd $(JS) && node_modules/.bin/esbuild web/study.ts --bundle --format=iife --minify --target=es2022 \
		--outfile=../web/study.js --log-level=warning
	@touch $@
web: $(BUILD)/web/index.html ## build the viewer in build/web: lightprobed --publish=ws:127.0.0.1:7701?root=build/web

test-js: build $(call apt,web) ## run the tests of the JavaScript package and the viewer, also in Chromium
	@cd $(JS) && npm test --silent

.PHONY: test-nightly-js
test-nightly-js: build $(call apt,web) ## run the tests of the JavaScript package and the viewer, also those that take long
	@cd $(JS) && NIGHTLY=1 npm test --silent

.PHONY: soak-page
soak-page: build $(call apt,web) $(BUILD)/scenes/blender.stamp ## show the live viewer of the demo in Chromium for an hour: its memory must not grow; MINUTES=n
	@cd $(JS) && node dist/test/soak.js

.PHONY: web-pictures
web-pictures: build $(call apt,web) $(BUILD)/scenes/blender.stamp ## take pictures of the viewer in Chromium, in a CC0 panorama, on a desktop and on a phone: docs/users/web_*.jpg, or in PICTURES=folder
	@cd $(JS) && node dist/test/pictures.js

# Engines from npm: Babylon.js, A-Frame and <model-viewer>, to read lightprobe-webxr.js; these, react-three-fiber and PlayCanvas for the components.
WEBXR := $(BUILD)/webxr
$(WEBXR)/installed: tests/engines/webxr/package.json tests/engines/webxr/package-lock.json tests/engines/webxr/.npmrc | $(call apt,web)
	@echo 'npm: tests/engines/webxr'
	@mkdir -p $(@D) && cp $^ $(@D)
	@cd $(@D) && npm ci --silent
	@touch $@

.PHONY: test-webxr test-components bench-webxr
test-webxr: build $(WEBXR)/installed ## test lightprobe-webxr.js in pages of Babylon.js, A-Frame and <model-viewer> (380 MB from npm)
	@cd $(JS) && node dist/test/again.js dist/test/webxr_engines.js

test-components: build $(WEBXR)/installed ## test the components for react-three-fiber, A-Frame, Babylon.js and PlayCanvas in their engines (380 MB from npm)
	@cd $(JS) && node_modules/.bin/tsc --project tsconfig.engines.json
	@cd $(JS) && node dist/test/again.js dist/test/components.js

bench-webxr: build $(call apt,web) ## print the size of lightprobe-webxr.js and what it takes of a frame, in Chromium with graphics in software
	@cd $(JS) && node dist/test/webxr_times.js

# The Blender extension, and the real Blender to test it: bpy from PyPI, in a Python of its own.
BLENDER := $(BUILD)/blender
BLENDER_SOURCES := $(wildcard clients/blender/addon/* clients/blender/tools/*.py host_py/lightprobe/*.py)
BUILD_EXTENSION := $(VENV)/bin/python clients/blender/tools/build_extension.py --out $(BLENDER)

.PHONY: blender test-blender
$(BLENDER)/built: $(BLENDER_SOURCES) host_py/constraints.txt proto/lightprobe.proto proto/ranges.toml proto/ranges.py | $(STAMPS)/venv
	@$(BUILD_EXTENSION)
	@touch $@
blender: $(BLENDER)/built ## build the Blender extension for this machine in build/blender; PLATFORM=windows-x64, macos-arm64, …: for another one, too
	@$(if $(PLATFORM),$(BUILD_EXTENSION) --platform $(PLATFORM))

$(BLENDER)/installed: tests/engines/blender/requirements.txt
	@echo 'setup: Blender as a Python module into $(BLENDER)/venv (350 MB)'
	@[ -x $(BLENDER)/venv/bin/python ] || $(PYTHON) -m venv $(BLENDER)/venv
	@$(BLENDER)/venv/bin/pip install --quiet --disable-pip-version-check -r $<
	@touch $@

test-blender: build $(BLENDER)/installed $(BLENDER)/built ## test the Blender extension in the real Blender (350 MB from PyPI)
	@$(BLENDER)/venv/bin/python -m pytest -q -s -W ignore::pytest.PytestConfigWarning tests/engines/blender

# The C# package: compiled and run by mono.
.PHONY: test-csharp
test-csharp: build $(call apt,csharp) ## test the C# package for Unity, by mono
	@$(MAKE) VARIANT=asan -j$(JOBS) daemon
	@$(VENV)/bin/pytest -q tests/engines/csharp
