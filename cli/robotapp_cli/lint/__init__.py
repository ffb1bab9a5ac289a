"""`lint`: what is wrong with a file, found without a cluster. Text in, findings out; files and printing are the command's."""
