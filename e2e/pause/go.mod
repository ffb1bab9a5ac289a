module robotapp/pause

go 1.26
