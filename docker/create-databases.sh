#!/bin/sh
# Run once by PostgreSQL's image when the volume is empty: a database and an owner for each server.
set -eu

for name in prefect mlflow; do
    case $name in
        prefect) password=$PREFECT_DATABASE_PASSWORD ;;
        mlflow) password=$MLFLOW_DATABASE_PASSWORD ;;
    esac
    psql --username "${POSTGRES_USER:-postgres}" --dbname postgres --set ON_ERROR_STOP=1 \
        --set name="$name" --set password="$password" <<'SQL'
CREATE ROLE :"name" LOGIN PASSWORD :'password';
CREATE DATABASE :"name" OWNER :"name";
SQL
done
