#!/bin/sh
# Mitsuba's fast variant (llvm) needs an LLVM of version 17 or newer, and Dr.Jit needs libatomic; no Python wheel carries them.
# Install Debian's or Ubuntu's packages where this user may; where not, say what is lost and go on: without LLVM, saf-gen
# renders with the scalar variant, slower and as right. Never fails.
have() {
  for library in "$@"; do [ -e "$library" ] && return 0; done
  return 1
}
have /usr/lib/*/libatomic.so.1 /usr/lib64/libatomic.so.1 \
  && have /usr/lib/*/libLLVM.so.1[7-9]* /usr/lib/*/libLLVM.so.2[0-9]* \
          /usr/lib/*/libLLVM-1[7-9].so* /usr/lib/llvm-1[7-9]/lib/libLLVM*.so* \
          /usr/lib64/libLLVM.so.1[7-9]* /usr/lib64/libLLVM.so.2[0-9]* \
  && exit 0
if command -v apt-get >/dev/null 2>&1; then
  # A mirror that does not answer must not hold up the set-up: five minutes for each try.
  if [ "$(id -u)" = 0 ]; then as_root="timeout 300"; else as_root="timeout 300 sudo -n"; fi
  echo "installing libllvm19 and libatomic1 (for Mitsuba's fast renderer)"
  $as_root apt-get install -y -q libllvm19 libatomic1 >/dev/null 2>&1 && exit 0
  $as_root apt-get update -q >/dev/null 2>&1
  $as_root apt-get install -y -q libllvm19 libatomic1 >/dev/null 2>&1 && exit 0
fi
echo "libllvm19 and libatomic1 could not be installed here: saf-gen will render with Mitsuba's scalar variant, many times"
echo "slower. To be faster: install LLVM 17 or newer (Debian, Ubuntu: apt install libllvm19), then: saf-gen doctor"
exit 0
