//! OctoMap files, written and read, with Debian's liboctomap as the referee of the tests.
