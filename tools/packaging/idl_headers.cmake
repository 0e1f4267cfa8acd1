# idlc's headers name the folders that they were made in, in their comments and guards: copies that do not, for
# installing. cmake -DFROM=BUILD -DTO=DIR -P idl_headers.cmake
foreach(name device scene)
  file(READ ${FROM}/${name}.h text)
  string(TOUPPER ${name} upper)
  string(REGEX REPLACE "DDSC_[A-Z0-9_]*_${upper}_H" "HAPTICD_IDL_${upper}_H" text "${text}")
  string(REGEX REPLACE "(File name|Source): [^\n]*/" "\\1: " text "${text}")
  file(WRITE ${TO}/${name}.h "${text}")
endforeach()
