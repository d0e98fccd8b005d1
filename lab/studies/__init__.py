"""The studies: a file each beside the runner, `lab.study`."""
