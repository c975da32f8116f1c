#!/bin/sh
# The tests marked `browser` show the leaderboard's page in headless Chromium. Install Debian's where this user
# may; where not, say what is lost and go on: those tests are then skipped, by name. Never fails.
there() {
  for browser in chromium chromium-browser google-chrome-stable google-chrome; do
    command -v "$browser" >/dev/null 2>&1 && "$browser" --version >/dev/null 2>&1 && exit 0
  done
}
there
if command -v apt-get >/dev/null 2>&1; then
  # A mirror that does not answer must not hold up the tests: five minutes for each try.
  if [ "$(id -u)" = 0 ]; then as_root="timeout 300"; else as_root="timeout 300 sudo -n"; fi
  echo "installing chromium (for the tests of the leaderboard's page)"
  $as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends chromium >/dev/null 2>&1
  there  # Ubuntu's package of that name is an empty one where there is no snap
  $as_root env DEBIAN_FRONTEND=noninteractive apt-get update -q >/dev/null 2>&1
  $as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends chromium >/dev/null 2>&1
  there
fi
echo "Chromium could not be installed here: the tests of the page in a browser are skipped."
echo "To run them: install Chromium or Chrome (Debian: apt install chromium), then: make clean test"
exit 0
